//! Headless training that panics: what was learnt is kept, beside whatever an earlier run has left.

use super::failure::Failure;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::path::Path;
use vbgs_studio::pipeline::panic_text::{NO_WORDS, panic_text};
use vbgs_studio::pipeline::session::Session;

/// What is left of a run that panicked. By a name of its own: a frame may be half learnt in it, and a save on
/// the way is whole.
const RESCUED: &str = "checkpoint-rescued.vbgs";

/// Trains, and returns how that ended.
///
/// # Errors
/// A panic: hours of frames must not go down with one of them, so the error says where they are.
pub fn guarded<T>(
    session: &mut Session,
    out: &Path,
    train: impl FnOnce(&mut Session) -> T,
) -> Result<T, Failure> {
    catch_unwind(AssertUnwindSafe(|| train(session))).map_err(|panic| {
        let said = panic_text(&*panic).unwrap_or(NO_WORDS);
        let (frames, path) = (session.learner().frames(), out.join(RESCUED));
        let save = || match session.save_after_panic(&path) {
            Ok(()) => format!(
                "the scene with its {frames} frames is in {}: go on with --resume, or export it",
                path.display()
            ),
            Err(problem) => {
                format!("the scene with its {frames} frames cannot be saved: {problem}")
            }
        };
        let rescued = if frames > 0 { save() } else { "no frame was learnt yet".to_owned() };
        Failure::failed(anyhow::anyhow!(
            "training was ended by a defect of this program, please report it: {said}; {rescued}"
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

    /// A run whose training panics behind so many frames; what is said, and the frames that were rescued.
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
            Session::new(room, SceneOverrides::default(), Selection::everything()).unwrap();
        let out = tempfile::tempdir().unwrap();
        let ended: Result<(), _> = guarded(&mut session, out.path(), |session| {
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
        assert!(said.contains("no frame was learnt") && frames.is_none(), "{said}");
    }
}
