//! Detection of views that a model was trained on, by the frames of its run. Split names do not suffice,
//! since two splits may list the same frame and any split can be used for training.

use super::measure::Views;
use crate::dataset::{Dataset, FrameEntry};
use std::collections::HashSet;
use std::path::Path;

/// Counts the `views` that are among the frames trained on, `learnt`.
pub fn learnt_views(dataset: &Dataset, learnt: Views<'_>, views: Views<'_>) -> usize {
    let marks = |(split, frames): Views<'_>| -> Vec<(String, Option<&Path>)> {
        let all = dataset.splits.get(split).map_or(&[][..], |split| &split.frames);
        frames.iter().filter_map(|&i| all.get(i)).map(photograph_key).collect()
    };
    let learnt: HashSet<_> = marks(learnt).into_iter().collect();
    marks(views).iter().filter(|view| learnt.contains(*view)).count()
}

/// Identifies a photograph across splits.
fn photograph_key(frame: &FrameEntry) -> (String, Option<&Path>) {
    (frame.name.clone(), frame.color_path())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::synthetic::{SyntheticParams, dataset};

    #[test]
    fn frames_count_whatever_their_split_is_called() {
        let small = SyntheticParams {
            width: 16,
            height: 12,
            n_train: 6,
            n_eval: 2,
            ..SyntheticParams::demo()
        };
        let mut room = dataset(&small).unwrap();
        assert_eq!(learnt_views(&room, (0, &[0, 1, 2, 2]), (0, &[1, 2, 3])), 2);
        assert_eq!(learnt_views(&room, (0, &[0, 1]), (1, &[0, 1])), 0);
        room.splits[1].frames = room.splits[0].frames[..2].to_vec();
        assert_eq!(learnt_views(&room, (0, &[0, 5]), (1, &[0, 1])), 1);
        assert_eq!(learnt_views(&room, (7, &[0]), (0, &[0, 99])), 0);
    }
}
