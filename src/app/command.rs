//! User commands: label, tooltip and shortcut of each, and the table of commands available in each state.
//! Buttons, shortcuts (`shortcuts.rs`) and the help list are generated from it.

use super::state::{RunState, Source};
use eframe::egui::{Context, Key, KeyboardShortcut, Modifiers};

/// User command.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum UiCommand {
    /// Open a dataset or a model.
    Open,
    /// Train the built-in demo scene.
    OpenDemo,
    /// Train until paused or finished.
    Train,
    /// Stop after the current frame.
    Pause,
    /// Train one frame.
    Step,
    /// Toggle training on frames as they are recorded.
    Follow,
    /// Restart training on the same dataset.
    Reset,
    /// Save a checkpoint.
    Save,
    /// Export the splats.
    Export,
    /// Save the view as an image.
    SavePicture,
    /// Move the camera so that the whole scene is visible.
    FrameScene,
    /// Return to the initial view.
    Home,
    /// Switch between the two renderers.
    ToggleRenderer,
    /// Move to the previous camera of the dataset.
    PreviousCamera,
    /// Move to the next camera of the dataset.
    NextCamera,
    /// Toggle the camera that follows the frame being trained.
    AutoCamera,
    /// Toggle the measuring tool.
    Measure,
    /// Toggle box selection by dragging.
    BoxSelect,
    /// Hide the selected splats.
    HideSelected,
    /// Show all hidden splats.
    ShowHidden,
    /// Exclude the selected splats from view and exports.
    DeleteSelected,
    /// Restore all deleted splats.
    RestoreDeleted,
    /// Toggle the crop box.
    CropBox,
    /// Redo the last undone edit.
    Redo,
    /// Undo the last edit.
    Undo,
    /// Toggle the dataset's cameras.
    Cameras,
    /// Toggle the points of the current frame.
    Points,
    /// Toggle ground grid and axes.
    Grid,
    /// Toggle the frame strip.
    FrameStrip,
    /// Restore the default layout of panels and frame strip.
    ResetLayout,
    /// Toggle the comparison with the photograph.
    ComparePhoto,
    /// Open a second model to compare with.
    CompareModel,
    /// Close the second model.
    RemoveModel,
    /// Clear the selection.
    Deselect,
    /// Copy the equivalent `train` command line to the clipboard.
    CopyCommandLine,
    /// Open the action finder.
    Find,
    /// Move the keyboard focus to the controls, or back to the view.
    FocusControls,
    /// Toggle the list of shortcuts.
    Help,
    /// Close the window.
    Quit,
}

impl UiCommand {
    /// Every command, in the order of the help list.
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
        UiCommand::AutoCamera,
        UiCommand::Measure,
        UiCommand::BoxSelect,
        UiCommand::HideSelected,
        UiCommand::ShowHidden,
        UiCommand::DeleteSelected,
        UiCommand::RestoreDeleted,
        UiCommand::CropBox,
        // Before `Undo`: its shortcut also matches while the additional modifier of Redo is held.
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
            UiCommand::AutoCamera => "Auto camera",
            UiCommand::Measure => "Measure",
            UiCommand::BoxSelect => "Box select",
            UiCommand::HideSelected => "Hide",
            UiCommand::ShowHidden => "Show hidden",
            UiCommand::DeleteSelected => "Delete",
            UiCommand::RestoreDeleted => "Restore deleted",
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
            UiCommand::FocusControls => "Focus controls",
            UiCommand::Help => "Shortcuts",
            UiCommand::Quit => "Quit",
        }
    }

    /// Name out of context, where no neighbouring button explains it.
    pub fn full_name(self) -> &'static str {
        match self {
            UiCommand::PreviousCamera => "Previous camera",
            UiCommand::NextCamera => "Next camera",
            UiCommand::HideSelected => "Hide selected splats",
            UiCommand::ShowHidden => "Show hidden splats",
            UiCommand::DeleteSelected => "Delete selected splats",
            UiCommand::RestoreDeleted => "Restore deleted splats",
            UiCommand::Points => "Points of the current frame",
            UiCommand::Redo => "Redo edit",
            UiCommand::Undo => "Undo edit",
            other => other.label().trim_end_matches('…'),
        }
    }

    /// One sentence of explanation.
    pub fn tooltip(self) -> &'static str {
        match self {
            UiCommand::Open => "Open a dataset folder, a checkpoint or a splat file",
            UiCommand::OpenDemo => "Train the built-in synthetic scene",
            UiCommand::Train => "Train on all remaining frames",
            UiCommand::Pause => "Stop after the current frame",
            UiCommand::Step => "Train on exactly one frame",
            UiCommand::Follow => "Train on new frames while a recording is still running",
            UiCommand::Reset => "Discard the trained scene and start over with the same dataset",
            UiCommand::Save => "Save a checkpoint from which training can resume",
            UiCommand::Export => "Export the scene as a splat file",
            UiCommand::SavePicture => "Save the view as a PNG next to the open file or folder",
            UiCommand::FrameScene => "Move the camera so that the whole scene is visible",
            UiCommand::Home => "Return to the initial view of the scene",
            UiCommand::ToggleRenderer => "Switch between the projected and the exact renderer",
            UiCommand::PreviousCamera => "Move to the previous camera of the dataset",
            UiCommand::NextCamera => "Move to the next camera of the dataset",
            UiCommand::AutoCamera => {
                "The camera follows the frame being trained until you move the camera"
            }
            UiCommand::Measure => "Measure the distance between two clicked points",
            UiCommand::BoxSelect => {
                "Drag a box to select splats, including occluded ones; Shift adds, Ctrl removes"
            }
            UiCommand::HideSelected => {
                "Hide the selected splats in the viewport; exports still include them"
            }
            UiCommand::ShowHidden => "Show all hidden splats again",
            UiCommand::DeleteSelected => {
                "Exclude the selected splats from view and exports; the model and its checkpoints are unchanged"
            }
            UiCommand::RestoreDeleted => "Show and export all deleted splats again",
            UiCommand::CropBox => {
                "Crop the scene to a box around the selection, or around everything; again removes the box"
            }
            UiCommand::Redo => "Redo the last undone edit",
            UiCommand::Undo => "Undo the last selection, hiding, deletion or crop",
            UiCommand::Cameras => "Show or hide the cameras of the dataset",
            UiCommand::Points => "Show or hide the measured points of the current frame",
            UiCommand::Grid => "Show or hide the ground grid and the axes",
            UiCommand::FrameStrip => "Show or hide the frames below the viewport",
            UiCommand::ResetLayout => "Restore the default layout of panels and frame strip",
            UiCommand::ComparePhoto => "Compare with the photograph of a dataset camera, or stop",
            UiCommand::CompareModel => {
                "Open a second checkpoint or splat file and compare it with the scene by a wipe"
            }
            UiCommand::RemoveModel => "Close the second model",
            UiCommand::Deselect => "Clear the selection; click a splat to select it",
            UiCommand::CopyCommandLine => {
                "Copy the command that trains this dataset with these settings without a window"
            }
            UiCommand::Find => "Find any action by typing part of its name",
            UiCommand::FocusControls => "Focus the controls (Tab for the next), or the view",
            UiCommand::Help => "Show all keyboard and mouse shortcuts",
            UiCommand::Quit => "Close the window; unsaved training must be confirmed",
        }
    }

    /// True if the command is available in this state. This is the only table of states and commands.
    pub fn is_available(self, state: RunState, source: Source) -> bool {
        use RunState::{Empty, Failed, Finished, Loading, Paused, Ready, Training, Waiting};
        let dataset = source == Source::Dataset;
        match self {
            UiCommand::Open | UiCommand::OpenDemo | UiCommand::Follow => state != Loading,
            UiCommand::Train => dataset && matches!(state, Ready | Paused),
            UiCommand::Pause => state == Training,
            UiCommand::Step => dataset && matches!(state, Ready | Paused),
            // Not in `Ready`: nothing is trained yet that could be reset or saved.
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
            of_view => match of_view.required_view_source() {
                Some(Source::Dataset) => dataset,
                Some(_) => source != Source::Nothing,
                // A command missing from both tables is never available, which the test below detects.
                None => false,
            },
        }
    }

    /// Kind of content that a view command needs, a dataset or any model; `None` for other commands.
    fn required_view_source(self) -> Option<Source> {
        match self {
            UiCommand::PreviousCamera
            | UiCommand::NextCamera
            | UiCommand::AutoCamera
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
            | UiCommand::RestoreDeleted
            | UiCommand::CropBox
            | UiCommand::Redo
            | UiCommand::Undo
            | UiCommand::Grid
            | UiCommand::Deselect => Some(Source::Model),
            _ => None,
        }
    }

    /// True if the view alone executes the command.
    pub fn is_view_command(self) -> bool {
        self.required_view_source().is_some()
    }

    /// Reason why the command is unavailable, if any.
    pub fn unavailable_reason(self, state: RunState, source: Source) -> Option<&'static str> {
        if self.is_available(state, source) {
            return None;
        }
        let is_for = |source| RunState::ALL.iter().any(|&state| self.is_available(state, source));
        Some(match (state, source) {
            (RunState::Loading, _) => "A file or folder is being opened",
            (RunState::Waiting, _) => "The followed recording has no complete frame yet",
            (_, Source::Nothing) => "Nothing is open",
            (_, Source::Model) if !is_for(Source::Model) => {
                "The open model has no frames: open a dataset, or a checkpoint of one"
            }
            (RunState::Empty | RunState::Ready, _) => "No frame is trained yet",
            (RunState::Training, _) => "Training is running: pause it first",
            (RunState::Paused, _) => "Training is paused",
            (RunState::Finished, _) => "All frames are trained",
            (RunState::Failed, _) => "Training has failed: use Reset to start over",
        })
    }
}

impl UiCommand {
    /// Keys of the command.
    pub fn shortcuts(self) -> &'static [KeyboardShortcut] {
        const fn plain(key: Key) -> KeyboardShortcut {
            KeyboardShortcut::new(Modifiers::NONE, key)
        }
        const fn control(key: Key) -> KeyboardShortcut {
            KeyboardShortcut::new(Modifiers::COMMAND, key)
        }
        match self {
            UiCommand::Open => const { &[control(Key::O)] },
            UiCommand::OpenDemo
            | UiCommand::Follow
            | UiCommand::CompareModel
            | UiCommand::RemoveModel
            | UiCommand::ResetLayout
            | UiCommand::RestoreDeleted
            | UiCommand::CropBox
            | UiCommand::CopyCommandLine
            | UiCommand::SavePicture
            | UiCommand::Quit => &[],
            // One key for both, of which only one is available at a time.
            UiCommand::Train | UiCommand::Pause => const { &[plain(Key::Space)] },
            UiCommand::Step => const { &[plain(Key::Period)] },
            UiCommand::Reset => const { &[control(Key::R)] },
            UiCommand::Save => const { &[control(Key::S)] },
            UiCommand::Export => const { &[control(Key::E)] },
            UiCommand::FrameScene => const { &[plain(Key::F)] },
            UiCommand::Home => const { &[plain(Key::H)] },
            UiCommand::ToggleRenderer => const { &[plain(Key::Tab)] },
            UiCommand::PreviousCamera => {
                const { &[plain(Key::OpenBracket), plain(Key::ArrowLeft)] }
            }
            UiCommand::NextCamera => const { &[plain(Key::CloseBracket), plain(Key::ArrowRight)] },
            UiCommand::AutoCamera => const { &[plain(Key::V)] },
            UiCommand::Measure => const { &[plain(Key::M)] },
            UiCommand::BoxSelect => const { &[plain(Key::B)] },
            UiCommand::HideSelected => const { &[plain(Key::K)] },
            UiCommand::ShowHidden => const { &[plain(Key::U)] },
            UiCommand::DeleteSelected => const { &[plain(Key::Delete)] },
            UiCommand::Redo => {
                const CONTROL_SHIFT: Modifiers = Modifiers::COMMAND.plus(Modifiers::SHIFT);
                const { &[KeyboardShortcut::new(CONTROL_SHIFT, Key::Z), control(Key::Y)] }
            }
            UiCommand::Undo => const { &[control(Key::Z)] },
            UiCommand::Cameras => const { &[plain(Key::C)] },
            UiCommand::Points => const { &[plain(Key::P)] },
            UiCommand::Grid => const { &[plain(Key::X)] },
            UiCommand::FrameStrip => const { &[plain(Key::T)] },
            UiCommand::ComparePhoto => const { &[plain(Key::G)] },
            UiCommand::Deselect => const { &[plain(Key::Escape)] },
            UiCommand::Find => const { &[control(Key::P)] },
            UiCommand::FocusControls => const { &[plain(Key::F6)] },
            UiCommand::Help => const { &[plain(Key::F1)] },
        }
    }

    /// Keys as shown in menus; empty if it has none.
    pub fn keys(self, ctx: &Context) -> String {
        let name = |shortcut: &KeyboardShortcut| {
            // `[` is clearer than its name; other symbols, such as arrows, are missing from the fonts.
            let symbol = shortcut.logical_key.symbol_or_name();
            match shortcut.modifiers {
                Modifiers::NONE if symbol.is_ascii() => symbol.to_owned(),
                _ => ctx.format_shortcut(shortcut),
            }
        };
        self.shortcuts().iter().map(name).collect::<Vec<_>>().join(" or ")
    }

    /// True if a focused control uses one of its keys: to be pressed, to change its value, or to move
    /// the focus.
    pub fn conflicts_with_controls(self) -> bool {
        const KEYS: [Key; 5] = [Key::Space, Key::Tab, Key::ArrowLeft, Key::ArrowRight, Key::Escape];
        self.shortcuts().iter().any(|shortcut| KEYS.contains(&shortcut.logical_key))
    }

    /// Tooltip with the keys.
    pub fn hint(self, ctx: &Context) -> String {
        match self.shortcuts() {
            [] => self.tooltip().to_owned(),
            _ => format!("{} ({})", self.tooltip(), self.keys(ctx)),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn in_no_state_is_nothing_possible_and_space_is_never_ambiguous() {
        for state in RunState::ALL {
            for source in [Source::Nothing, Source::Dataset, Source::Model] {
                assert!(UiCommand::ALL.iter().any(|c| c.is_available(state, source)));
                let both = UiCommand::Train.is_available(state, source)
                    && UiCommand::Pause.is_available(state, source);
                assert!(!both, "{state:?}");
            }
        }
        for command in UiCommand::ALL {
            let somewhere = RunState::ALL.iter().any(|&s| command.is_available(s, Source::Dataset));
            assert!(somewhere, "{command:?} has no row in the table");
            let alone = command.is_available(RunState::Finished, Source::Nothing);
            assert!(
                !(command.is_view_command() && alone),
                "{command:?} is available without a view"
            );
        }
        assert!(!UiCommand::Train.is_available(RunState::Finished, Source::Dataset));
        assert!(!UiCommand::Reset.is_available(RunState::Finished, Source::Model));
        assert!(
            UiCommand::Export.is_available(RunState::Failed, Source::Dataset),
            "a trained scene stays usable"
        );
    }
}
