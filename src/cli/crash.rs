//! Saves the scene if headless training panics.

use super::failure::Failure;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use vbgs_studio::pipeline::panic_text::{NO_MESSAGE, panic_text};
use vbgs_studio::pipeline::session::Session;

/// File for the scene of a run that panicked. It has a name of its own because its last frame may be
/// incomplete, while regular checkpoints are consistent.
const RESCUED: &str = "checkpoint-rescued.vbgs";

/// Runs training and returns its result.
///
/// # Errors
/// A panic; the scene is saved first, and the message states where.
pub fn save_on_panic<T>(
    session: &mut Session,
    out: &Path,
    train: impl FnOnce(&mut Session) -> T,
) -> Result<T, Failure> {
    catch_unwind(AssertUnwindSafe(|| train(session))).map_err(|panic| {
        let said = panic_text(&*panic).unwrap_or(NO_MESSAGE);
        let (frames, path) = (session.learner().frames(), out.join(RESCUED));
        let save = || match session.save_after_panic(&path) {
            Ok(()) => format!(
                "the scene with its {frames} frames is in {}: continue with --resume, or export it",
                path.display()
            ),
            Err(problem) => {
                format!("the scene with its {frames} frames cannot be saved: {problem}")
            }
        };
        let rescued = if frames > 0 { save() } else { "no frame was trained yet".to_owned() };
        Failure::failed(anyhow::anyhow!(
            "training crashed because of a bug, please report it: {said}; {rescued}"
        ))
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use vbgs_studio::dataset::synthetic::{SyntheticParams, dataset};
    use vbgs_studio::pipeline::checkpoint::SavedRun;
    use vbgs_studio::pipeline::plan::Selection;
    use vbgs_studio::pipeline::settings::scene::SceneOverrides;

    /// Runs a training that panics after `after` frames; returns the message and the number of saved frames.
    fn crashed(after: usize) -> (String, Option<u64>) {
        let small = SyntheticParams {
            width: 32,
            height: 24,
            n_train: 4,
            n_eval: 0,
            ..SyntheticParams::demo()
        };
        let room = Arc::new(dataset(&small).unwrap());
        let mut session =
            Session::new(room, SceneOverrides::default(), Selection::all_frames()).unwrap();
        let out = tempfile::tempdir().unwrap();
        let ended: Result<(), _> = save_on_panic(&mut session, out.path(), |session| {
            (0..after).for_each(|_| drop(session.step().unwrap()));
            panic!("injected behind {after}")
        });
        let Err(Failure::Failed(error)) = ended else { panic!("a failure") };
        let rescued = SavedRun::read(&out.path().join(RESCUED));
        (error.to_string(), rescued.ok().map(|run| run.content.cursor.frames))
    }

    #[test]
    fn a_panic_of_training_costs_no_frame_and_is_told() {
        let (said, frames) = crashed(3);
        assert_eq!(frames, Some(3));
        for part in ["injected behind 3", "its 3 frames", RESCUED, "--resume"] {
            assert!(said.contains(part), "{part:?} is missing in: {said}");
        }
        let (said, frames) = crashed(0);
        assert!(said.contains("no frame was trained") && frames.is_none(), "{said}");
    }
}
