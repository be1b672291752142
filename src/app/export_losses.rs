//! Describes what an exported splat file loses compared with the scene.

use crate::export::ModelFormat;
use crate::export::mapping::{GradientSplit, Mapping, OpacityMapping, is_plain};
use crate::model::splat::appearance::SplatView;

/// One sentence for each loss of exporting these splats to `format`.
pub fn losses(scene: SplatView<'_>, format: ModelFormat, mapping: Mapping) -> Vec<String> {
    let mut losses = Vec::new();
    if !is_plain(scene) {
        describe_plain_losses(scene, mapping, &mut losses);
    }
    if scene.finishing().exposures.is_some() {
        losses.push("Exposures of the photographs are not stored".to_owned());
    }
    if format == ModelFormat::Spz {
        losses.push(
            "SPZ quantises: positions to an eighth of a small splat, sizes and colours to 8 bits"
                .to_owned(),
        );
    }
    losses.push(
        "Evidence and uncertainty are not stored; a checkpoint (Save) stores them".to_owned(),
    );
    losses
}

fn describe_plain_losses(scene: SplatView<'_>, mapping: Mapping, losses: &mut Vec<String>) {
    let splats = || scene.splats().iter().enumerate().filter(|(_, splat)| splat.is_drawable());
    let n_opaque = splats().filter(|(_, splat)| splat.opacity > 1.0).count();
    if n_opaque > 0 {
        let become_what = match mapping.opacity {
            OpacityMapping::EqualArea => "0.99, with larger splats",
            OpacityMapping::Clip => "0.99",
        };
        losses.push(format!("Opacity above 1 of {n_opaque} splats: reduced to {become_what}"));
    }
    let varies = |i: usize| {
        scene.appearance().get(i).is_some_and(|appearance| appearance.gradient != [[0.0; 3]; 3])
    };
    let n_varying = splats().filter(|(i, _)| varies(*i)).count();
    if n_varying > 0 {
        let become_what = match mapping.split {
            GradientSplit::One => "replaced by one colour each",
            GradientSplit::Two => "replaced by two splats of one colour each",
            GradientSplit::Four => "replaced by four splats of one colour each",
        };
        losses.push(format!("Colour gradients of {n_varying} splats: {become_what}"));
    }
    if scene.finishing().full_coverage < 1.0 {
        losses.push(
            "Only this program closes the cracks between splats; other viewers show them"
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
        assert_eq!(told(&plain, ModelFormat::Ply).len(), 1, "evidence and uncertainty only");
        assert!(told(&plain, ModelFormat::Spz)[0].starts_with("SPZ quantises"));

        let mut native = SplatSet::from(vec![splat]);
        let gradient = [[1.0, 0.0, 0.0], [0.0; 3], [0.0; 3]];
        let appearance = Appearance { gradient, ..Appearance::default() };
        native.push(Splat { opacity: 2.0, ..splat }, appearance);
        // Transparent splats do not count.
        native.push(Splat { opacity: 0.0, ..splat }, appearance);
        let told_of = told(&native, ModelFormat::Glb);
        assert!(told_of[0].starts_with("Opacity above 1 of 1 splats"), "{told_of:?}");
        assert!(told_of[1].starts_with("Colour gradients of 1 splats"), "{told_of:?}");
        assert_eq!(told_of.len(), 3);
        let closed = native.finished(Finishing { full_coverage: 0.5, ..Finishing::default() });
        assert_eq!(told(&closed, ModelFormat::Glb).len(), 4);
    }
}
