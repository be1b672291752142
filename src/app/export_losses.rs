//! What a file of splats holds less than the scene, in words.

use crate::export::ModelFormat;
use crate::export::mapping::{GradientSplit, Mapping, OpacityMapping, is_plain};
use crate::model::splat::appearance::SplatView;

/// What a file of a format loses of these splats, a sentence each.
pub fn losses(scene: SplatView<'_>, format: ModelFormat, mapping: Mapping) -> Vec<String> {
    let mut losses = Vec::new();
    if !is_plain(scene) {
        made_plain(scene, mapping, &mut losses);
    }
    if scene.finishing().exposures.is_some() {
        losses.push("How bright each photograph was taken is not in the file".to_owned());
    }
    if format == ModelFormat::Spz {
        losses.push(
            "SPZ rounds: places to an eighth of a small splat, sizes and colours to 8 bits"
                .to_owned(),
        );
    }
    losses.push("Evidence and uncertainty stay behind: Save keeps them".to_owned());
    losses
}

fn made_plain(scene: SplatView<'_>, mapping: Mapping, losses: &mut Vec<String>) {
    let splats = || scene.splats().iter().enumerate().filter(|(_, splat)| splat.is_drawable());
    let n_opaque = splats().filter(|(_, splat)| splat.opacity > 1.0).count();
    if n_opaque > 0 {
        let become_what = match mapping.opacity {
            OpacityMapping::EqualArea => "0.99 and wider",
            OpacityMapping::Clip => "0.99",
        };
        losses.push(format!("{n_opaque} splats are more opaque than 1: they become {become_what}"));
    }
    let varies = |i: usize| {
        scene.appearance().get(i).is_some_and(|appearance| appearance.gradient != [[0.0; 3]; 3])
    };
    let n_varying = splats().filter(|(i, _)| varies(*i)).count();
    if n_varying > 0 {
        let become_what = match mapping.split {
            GradientSplit::One => "each becomes of one colour",
            GradientSplit::Two => "each becomes two of one colour",
            GradientSplit::Four => "each becomes four of one colour",
        };
        losses.push(format!("Over {n_varying} splats colour varies: {become_what}"));
    }
    if scene.finishing().full_coverage < 1.0 {
        losses.push(
            "Cracks between splats are closed by this program alone: others see through them"
                .to_owned(),
        );
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::model::splat::appearance::{Appearance, Finishing, SplatSet};
    use crate::model::splat::splats::Splat;

    #[test]
    fn only_what_is_lost_is_told() {
        let splat = Splat { opacity: 0.5, scale: [0.1; 3], ..Splat::default() };
        let told = |set: &SplatSet, format| losses(set.view(), format, Mapping::default());
        let plain = SplatSet::from(vec![splat]);
        assert_eq!(told(&plain, ModelFormat::Ply).len(), 1, "what only checkpoints hold");
        assert!(told(&plain, ModelFormat::Spz)[0].starts_with("SPZ rounds"));

        let mut native = SplatSet::from(vec![splat]);
        let gradient = [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]];
        let appearance = Appearance { gradient, ..Appearance::default() };
        native.push(Splat { opacity: 2.0, ..splat }, appearance);
        // Nobody sees it.
        native.push(Splat { opacity: 0.0, ..splat }, appearance);
        let told_of = told(&native, ModelFormat::Glb);
        assert!(told_of[0].starts_with("1 splats are more opaque"), "{told_of:?}");
        assert!(told_of[1].starts_with("Over 1 splats colour varies"), "{told_of:?}");
        assert_eq!(told_of.len(), 3);
        let closed = native.finished(Finishing { full_coverage: 0.5, ..Finishing::default() });
        assert_eq!(told(&closed, ModelFormat::Glb).len(), 4);
    }
}
