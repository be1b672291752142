//! What a user can ask for: label, tooltip and shortcut in one place, and the one table of what is
//! legal in which state. Buttons, keys (`shortcuts.rs`) and the help list come from here.

use super::state::{RunState, Source};

/// A request of the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UiCommand {
    /// Open a dataset or a model.
    Open,
    /// Load and train the built-in demo.
    OpenDemo,
    /// Train until paused or done.
    Train,
    /// Stop after the current frame.
    Pause,
    /// Train one frame.
    Step,
    /// Take frames while they are recorded, or no longer.
    Follow,
    /// Start over with the same dataset.
    Reset,
    /// Write the run to a file it can go on from.
    Save,
    /// Write the scene to a file.
    Export,
    /// Write the picture of the view to a file.
    SavePicture,
    /// Frame the whole scene.
    FrameScene,
    /// Back to where the scene was opened.
    Home,
    /// The other of the two renderers.
    ToggleRenderer,
    /// Stand at the dataset's camera before.
    PreviousCamera,
    /// Stand at the dataset's next camera.
    NextCamera,
    /// The camera goes where training is, or stays.
    RideAlong,
    /// Clicks measure, or select again.
    Measure,
    /// Drags over the viewport select splats, or turn the camera again.
    BoxSelect,
    /// Show what is selected no more.
    HideSelected,
    /// Show what was hidden.
    ShowHidden,
    /// Leave what is selected out of view and files.
    DeleteSelected,
    /// Leave nothing out that was deleted.
    BringBack,
    /// Cut the scene by a box, or no longer.
    CropBox,
    /// Make the edit again that was taken back last.
    Redo,
    /// Take the last edit back.
    Undo,
    /// Show the dataset's cameras, or hide them.
    Cameras,
    /// Show the points of the current frame, or hide them.
    Points,
    /// Show ground and axes, or hide them.
    Grid,
    /// Show the strip of frames, or fold it away.
    FrameStrip,
    /// Panels and strip back to where they were at first.
    ResetLayout,
    /// Compare with the photograph, or stop doing so.
    ComparePhoto,
    /// Choose a second model to compare with.
    CompareModel,
    /// Compare with no second model any more.
    RemoveModel,
    /// Select no splat any more.
    Deselect,
    /// The command that trains likewise without a window, to the clipboard.
    CopyCommandLine,
    /// Find an action by its name.
    Find,
    /// The keyboard to the controls, or back to the view.
    FocusControls,
    /// List of all shortcuts.
    Help,
    /// Close the window.
    Quit,
}

impl UiCommand {
    /// Every command, in the order help shows them.
    pub const ALL: [UiCommand; 39] = [
        UiCommand::Open,
        UiCommand::OpenDemo,
        UiCommand::Train,
        UiCommand::Pause,
        UiCommand::Step,
        UiCommand::Follow,
        UiCommand::Reset,
        UiCommand::Save,
        UiCommand::Export,
        UiCommand::SavePicture,
        UiCommand::FrameScene,
        UiCommand::Home,
        UiCommand::ToggleRenderer,
        UiCommand::PreviousCamera,
        UiCommand::NextCamera,
        UiCommand::RideAlong,
        UiCommand::Measure,
        UiCommand::BoxSelect,
        UiCommand::HideSelected,
        UiCommand::ShowHidden,
        UiCommand::DeleteSelected,
        UiCommand::BringBack,
        UiCommand::CropBox,
        // Before `Undo`, whose keys are held too where its own are.
        UiCommand::Redo,
        UiCommand::Undo,
        UiCommand::Cameras,
        UiCommand::Points,
        UiCommand::Grid,
        UiCommand::FrameStrip,
        UiCommand::ResetLayout,
        UiCommand::ComparePhoto,
        UiCommand::CompareModel,
        UiCommand::RemoveModel,
        UiCommand::Deselect,
        UiCommand::CopyCommandLine,
        UiCommand::Find,
        UiCommand::FocusControls,
        UiCommand::Help,
        UiCommand::Quit,
    ];

    /// Text on the button.
    pub fn label(self) -> &'static str {
        match self {
            UiCommand::Open => "Open…",
            UiCommand::OpenDemo => "Demo",
            UiCommand::Train => "Train",
            UiCommand::Pause => "Pause",
            UiCommand::Step => "Step",
            UiCommand::Follow => "Follow",
            UiCommand::Reset => "Reset",
            UiCommand::Save => "Save…",
            UiCommand::Export => "Export…",
            UiCommand::SavePicture => "Save picture",
            UiCommand::FrameScene => "Frame scene",
            UiCommand::Home => "Home view",
            UiCommand::ToggleRenderer => "Projected/exact",
            UiCommand::PreviousCamera => "‹",
            UiCommand::NextCamera => "›",
            UiCommand::RideAlong => "Ride along",
            UiCommand::Measure => "Measure",
            UiCommand::BoxSelect => "Box select",
            UiCommand::HideSelected => "Hide",
            UiCommand::ShowHidden => "Show hidden",
            UiCommand::DeleteSelected => "Delete",
            UiCommand::BringBack => "Bring back",
            UiCommand::CropBox => "Crop box",
            UiCommand::Redo => "Redo",
            UiCommand::Undo => "Undo",
            UiCommand::Cameras => "Cameras",
            UiCommand::Points => "Points",
            UiCommand::Grid => "Grid",
            UiCommand::FrameStrip => "Frame strip",
            UiCommand::ResetLayout => "Reset layout",
            UiCommand::ComparePhoto => "Photograph",
            UiCommand::CompareModel => "Compare with a model…",
            UiCommand::RemoveModel => "Remove second model",
            UiCommand::Deselect => "Deselect",
            UiCommand::CopyCommandLine => "Copy as command line",
            UiCommand::Find => "Find action…",
            UiCommand::FocusControls => "Controls by keyboard",
            UiCommand::Help => "Shortcuts",
            UiCommand::Quit => "Quit",
        }
    }

    /// Its name where it stands alone, beside no other button.
    pub fn name(self) -> &'static str {
        match self {
            UiCommand::PreviousCamera => "Previous camera",
            UiCommand::NextCamera => "Next camera",
            UiCommand::HideSelected => "Hide selected splats",
            UiCommand::ShowHidden => "Show hidden splats",
            UiCommand::DeleteSelected => "Delete selected splats",
            UiCommand::BringBack => "Bring deleted splats back",
            UiCommand::Points => "Points of the frame",
            UiCommand::Redo => "Redo edit",
            UiCommand::Undo => "Undo edit",
            other => other.label().trim_end_matches('…'),
        }
    }

    /// One sentence on what it does.
    pub fn tooltip(self) -> &'static str {
        match self {
            UiCommand::Open => "Open a dataset folder, a checkpoint or a file of splats",
            UiCommand::OpenDemo => "Train the built-in synthetic scene",
            UiCommand::Train => "Train frame by frame until the frames end",
            UiCommand::Pause => "Stop after the current frame",
            UiCommand::Step => "Train exactly one frame",
            UiCommand::Follow => "Take frames as they are recorded, also of what is opened next",
            UiCommand::Reset => "Forget the scene and start over with what was opened",
            UiCommand::Save => "Write a checkpoint that training can go on from",
            UiCommand::Export => "Write the scene as a file of splats",
            UiCommand::SavePicture => "Write the view as a PNG picture beside what is open",
            UiCommand::FrameScene => "Move the camera so that the whole scene is seen",
            UiCommand::Home => "Go back to the view the scene was opened with",
            UiCommand::ToggleRenderer => "Switch between the projected and the exact renderer",
            UiCommand::PreviousCamera => "Stand where the dataset's camera before stood",
            UiCommand::NextCamera => "Stand where the dataset's next camera stood",
            UiCommand::RideAlong => {
                "Look where the frame in training looks, until you move the camera"
            }
            UiCommand::Measure => "Measure between two clicked places",
            UiCommand::BoxSelect => {
                "Select splats by dragging over the picture, those behind others too; Shift adds, Ctrl takes away"
            }
            UiCommand::HideSelected => {
                "Show the selected splats no more; files get them all the same"
            }
            UiCommand::ShowHidden => "Show all splats again that were hidden",
            UiCommand::DeleteSelected => {
                "Leave the selected splats out of view and exports; the model and its checkpoints keep them"
            }
            UiCommand::BringBack => "Show and export all splats again that were deleted",
            UiCommand::CropBox => {
                "Leave out what is outside a box: around what is selected, else around everything; or no longer"
            }
            UiCommand::Redo => "Make the edit again that was taken back last",
            UiCommand::Undo => "Take the last selection, hiding, deleting or cropping back",
            UiCommand::Cameras => "Show where the photographs were taken, or hide it",
            UiCommand::Points => "Show what the current frame measured, in its colours, or hide it",
            UiCommand::Grid => "Show the ground through the origin and the axes, or hide them",
            UiCommand::FrameStrip => "Show the frames below the picture, or fold them away",
            UiCommand::ResetLayout => "Put panels and frame strip back where they were at first",
            UiCommand::ComparePhoto => "Compare with the photograph at a dataset's camera, or stop",
            UiCommand::CompareModel => {
                "Open a checkpoint or a file of splats beside the scene, to wipe between the two"
            }
            UiCommand::RemoveModel => "Compare with the second model no longer",
            UiCommand::Deselect => "Select no splat any more; a click on a splat selects it",
            UiCommand::CopyCommandLine => {
                "Copy the command that trains what is open by these settings without a window"
            }
            UiCommand::Find => "Find every action by some letters of its name",
            UiCommand::FocusControls => "Go to the controls (Tab leads on), or back to the view",
            UiCommand::Help => "Show all keyboard and mouse shortcuts",
            UiCommand::Quit => "Close the window; training that is in no file is asked about",
        }
    }

    /// Whether the command makes sense now: the one table of states and commands.
    pub fn is_legal(self, state: RunState, source: Source) -> bool {
        use RunState::{Empty, Failed, Finished, Loading, Paused, Ready, Training, Waiting};
        let dataset = source == Source::Dataset;
        match self {
            UiCommand::Open | UiCommand::OpenDemo | UiCommand::Follow => state != Loading,
            UiCommand::Train => dataset && matches!(state, Ready | Paused),
            UiCommand::Pause => state == Training,
            UiCommand::Step => dataset && matches!(state, Ready | Paused),
            // Not in `Ready`: nothing is trained yet that could be forgotten or saved.
            UiCommand::Reset | UiCommand::Save => {
                dataset && matches!(state, Training | Paused | Finished | Failed)
            }
            UiCommand::Export | UiCommand::SavePicture => {
                source != Source::Nothing && !matches!(state, Empty | Loading | Waiting)
            }
            UiCommand::CompareModel | UiCommand::RemoveModel => source != Source::Nothing,
            UiCommand::FrameStrip | UiCommand::CopyCommandLine => dataset,
            UiCommand::ResetLayout
            | UiCommand::Find
            | UiCommand::FocusControls
            | UiCommand::Quit
            | UiCommand::Help => true,
            of_view => match of_view.view_source() {
                Some(Source::Dataset) => dataset,
                Some(_) => source != Source::Nothing,
                // One that stands nowhere is legal nowhere, which the test below finds.
                None => false,
            },
        }
    }

    /// What the view has to show for the command, if it is one of the view's: a dataset, or any model.
    fn view_source(self) -> Option<Source> {
        match self {
            UiCommand::PreviousCamera
            | UiCommand::NextCamera
            | UiCommand::RideAlong
            | UiCommand::Cameras
            | UiCommand::Points
            | UiCommand::ComparePhoto => Some(Source::Dataset),
            UiCommand::FrameScene
            | UiCommand::Home
            | UiCommand::ToggleRenderer
            | UiCommand::Measure
            | UiCommand::BoxSelect
            | UiCommand::HideSelected
            | UiCommand::ShowHidden
            | UiCommand::DeleteSelected
            | UiCommand::BringBack
            | UiCommand::CropBox
            | UiCommand::Redo
            | UiCommand::Undo
            | UiCommand::Grid
            | UiCommand::Deselect => Some(Source::Model),
            _ => None,
        }
    }

    /// Whether it is the view alone that does it.
    pub fn is_of_view(self) -> bool {
        self.view_source().is_some()
    }

    /// Why the command makes no sense now, if so.
    pub fn why_not(self, state: RunState, source: Source) -> Option<&'static str> {
        if self.is_legal(state, source) {
            return None;
        }
        let is_for = |source| RunState::ALL.iter().any(|&state| self.is_legal(state, source));
        Some(match (state, source) {
            (RunState::Loading, _) => "Something is being opened",
            (RunState::Waiting, _) => "The recording that is followed holds no whole frame yet",
            (_, Source::Nothing) => "Nothing is open",
            (_, Source::Model) if !is_for(Source::Model) => {
                "What is open is a model without frames: open a dataset or a checkpoint of one"
            }
            (RunState::Empty | RunState::Ready, _) => "Nothing is trained yet",
            (RunState::Training, _) => "Frames are being trained: pause first",
            (RunState::Paused, _) => "Training rests",
            (RunState::Finished, _) => "Every frame is trained",
            (RunState::Failed, _) => "Training has failed: reset starts over",
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_no_state_is_nothing_possible_and_space_is_never_ambiguous() {
        for state in RunState::ALL {
            for source in [Source::Nothing, Source::Dataset, Source::Model] {
                assert!(UiCommand::ALL.iter().any(|c| c.is_legal(state, source)));
                let both = UiCommand::Train.is_legal(state, source)
                    && UiCommand::Pause.is_legal(state, source);
                assert!(!both, "{state:?}");
            }
        }
        for command in UiCommand::ALL {
            let somewhere = RunState::ALL.iter().any(|&s| command.is_legal(s, Source::Dataset));
            assert!(somewhere, "{command:?} has no row in the table");
            let alone = command.is_legal(RunState::Finished, Source::Nothing);
            assert!(!(command.is_of_view() && alone), "{command:?} of no view");
        }
        assert!(!UiCommand::Train.is_legal(RunState::Finished, Source::Dataset));
        assert!(!UiCommand::Reset.is_legal(RunState::Finished, Source::Model));
        assert!(
            UiCommand::Export.is_legal(RunState::Failed, Source::Dataset),
            "a trained scene stays usable"
        );
    }
}
