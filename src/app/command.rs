//! The table of user commands: label, tooltip, shortcuts, menu, and the states in which each is available.
//! Buttons, menus, shortcuts, the help list and the action finder are generated from it.

use super::state::{RunState, Source};
use eframe::egui::{Context, Key, KeyboardShortcut, Modifiers};

/// Declares the values of an enum in menu order, each with a label and a tooltip.
macro_rules! labelled {
    ($type:ident: $($value:ident: $label:literal, $tooltip:literal;)*) => {
        impl $type {
            // The length follows from the list, so that no value can be missing.
            pub const ALL: [Self; [$(Self::$value),*].len()] = [$(Self::$value),*];

            pub fn label(self) -> &'static str {
                match self {
                    $(Self::$value => $label,)*
                }
            }

            pub fn tooltip(self) -> &'static str {
                match self {
                    $(Self::$value => $tooltip,)*
                }
            }
        }
    };
}
pub(super) use labelled;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Needs {
    Nothing,
    /// Requires that no file or folder is being opened.
    NotLoading,
    /// Requires a dataset whose training can start or continue.
    Resting,
    Training,
    /// Requires a dataset whose training has started.
    Trained,
    /// Requires a dataset or model that can be drawn.
    Scene,
    Dataset,
    /// Requires a dataset or a model.
    Model,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Executor {
    Window,
    View,
}

/// Menus of the top bar. `Selection` is part of the view menu.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Menu {
    Open,
    Export,
    View,
    Selection,
    Help,
    Train,
}

struct CommandRow {
    /// Label, followed by a longer name if the label is clear only beside the labels of neighbouring
    /// buttons.
    names: &'static [&'static str],
    tooltip: &'static str,
    keys: &'static [KeyboardShortcut],
    menu: (Menu, u8),
    executor: Executor,
    needs: Needs,
}

const fn key(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::NONE, key)
}

// `COMMAND` is Cmd on macOS and Ctrl elsewhere.
const fn ctrl(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::COMMAND, key)
}

const fn ctrl_shift(key: Key) -> KeyboardShortcut {
    KeyboardShortcut::new(Modifiers::COMMAND.plus(Modifiers::SHIFT), key)
}

/// Declares the commands, one per row. A row contains label and longer name, tooltip, shortcuts, menu
/// and group in the menu, executor and requirement.
macro_rules! commands {
    ($($command:ident: [$($name:literal),+], $tooltip:literal, [$($key:expr),*],
        $menu:ident $group:literal, $executor:ident $needs:ident;)*) => {
        #[derive(Clone, Copy, Debug, PartialEq, Eq)]
        pub enum UiCommand {
            $($command,)*
        }

        impl UiCommand {
            /// All commands, in the order of the help list.
            pub const ALL: [Self; [$(Self::$command),*].len()] = [$(Self::$command),*];

            fn row(self) -> &'static CommandRow {
                match self {
                    // A constant block, because a row must outlive this call.
                    $(Self::$command => const {
                        &CommandRow {
                            names: &[$($name),+],
                            tooltip: $tooltip,
                            keys: &[$($key),*],
                            menu: (Menu::$menu, $group),
                            executor: Executor::$executor,
                            needs: Needs::$needs,
                        }
                    },)*
                }
            }
        }
    };
}

commands! {
    Open: ["Open…"], "Open a dataset folder, a checkpoint or a splat file",
        [ctrl(Key::O)], Open 0, Window NotLoading;
    OpenDemo: ["Demo"], "Train the built-in synthetic scene",
        [], Open 0, Window NotLoading;
    // One key for Train and Pause, of which only one is available at a time.
    Train: ["Train"], "Train on all remaining frames",
        [key(Key::Space)], Train 0, Window Resting;
    Pause: ["Pause"], "Stop after the current frame",
        [key(Key::Space)], Train 0, Window Training;
    Step: ["Step"], "Train on exactly one frame",
        [key(Key::Period)], Train 0, Window Resting;
    Follow: ["Live", "Follow a live recording"], "Train on new frames while a recording is still running",
        [], Open 1, Window NotLoading;
    Reset: ["Reset"], "Discard the trained scene and start over with the same dataset",
        [ctrl(Key::R)], Train 0, Window Trained;
    RetrainFiner: ["Retrain finer"], "Train again with twice as many splats; this scene stays beside the new one",
        [], Train 0, Window Trained;
    Export: ["Export…"], "Export splats, a point cloud or a mesh",
        [ctrl(Key::E)], Export 0, Window Scene;
    Save: ["Save…"], "Save a checkpoint from which training can resume",
        [ctrl(Key::S)], Export 0, Window Trained;
    SavePicture: ["Save picture"], "Save the view as a PNG of any size",
        [], Export 0, Window Scene;
    FrameScene: ["Frame scene"], "Move the camera so that the whole scene is visible",
        [key(Key::F)], View 0, View Model;
    Home: ["Home view"], "Return to the initial view of the scene",
        [key(Key::H)], View 0, View Model;
    ToggleRenderer: ["Projected/exact"], "Switch between the projected and the exact renderer",
        [key(Key::Tab)], View 1, View Model;
    PreviousCamera: ["Previous camera"], "Move to the previous camera of the dataset",
        [key(Key::OpenBracket), key(Key::ArrowLeft)], View 0, View Dataset;
    NextCamera: ["Next camera"], "Move to the next camera of the dataset",
        [key(Key::CloseBracket), key(Key::ArrowRight)], View 0, View Dataset;
    AutoCamera: ["Follow the camera"], "The view follows the frame being trained until you move it",
        [key(Key::V)], View 0, View Dataset;
    Measure: ["Measure"], "Measure the distance between two clicked points",
        [key(Key::M)], View 2, View Model;
    BoxSelect: ["Box select"], "Drag a box to select splats, including occluded ones; Shift adds, Ctrl removes",
        [key(Key::B)], Selection 1, View Model;
    HideSelected: ["Hide", "Hide selection"], "Hide the selected splats; they are still exported",
        [key(Key::K)], Selection 2, View Model;
    ShowHidden: ["Show hidden", "Show hidden splats"], "Show all hidden splats again",
        [key(Key::U)], Selection 2, View Model;
    DeleteSelected: ["Delete", "Delete selection"], "Delete from view and exports (checkpoints keep it)",
        [key(Key::Delete)], Selection 2, View Model;
    RestoreDeleted: ["Undelete all", "Undelete all splats"], "Show and export all deleted splats again",
        [], Selection 2, View Model;
    CropBox: ["Crop box"], "Crop the scene to a box around the selection, or around everything; again removes the box",
        [], Selection 2, View Model;
    Undo: ["Undo", "Undo edit"], "Undo the last selection, hiding, deletion or crop",
        [ctrl(Key::Z)], Selection 0, View Model;
    Redo: ["Redo", "Redo edit"], "Redo the last undone edit",
        [ctrl_shift(Key::Z), ctrl(Key::Y)], Selection 0, View Model;
    Cameras: ["Cameras"], "Show or hide the cameras of the dataset",
        [key(Key::C)], View 3, View Dataset;
    Points: ["Points", "Points of the current frame"], "Show or hide the measured points of the current frame",
        [key(Key::P)], View 3, View Dataset;
    Grid: ["Grid"], "Show or hide the ground grid and the axes",
        [key(Key::X)], View 3, View Model;
    FrameStrip: ["Frame strip"], "Show or hide the frames below the viewport",
        [key(Key::T)], View 3, Window Dataset;
    ResetLayout: ["Reset layout"], "Restore the default layout of panels and frame strip",
        [], View 3, Window Nothing;
    ComparePhoto: ["Compare with photograph"], "Compare with the photograph of a dataset camera, or stop",
        [key(Key::G)], View 1, View Dataset;
    CompareModel: ["Compare with a model…"], "Open a second checkpoint or splat file and compare it with the scene by a wipe",
        [], View 1, Window Model;
    RemoveModel: ["Remove second model"], "Close the second model",
        [], View 1, Window Model;
    Deselect: ["Deselect"], "Clear the selection; click a splat to select it",
        [key(Key::Escape)], Selection 1, View Model;
    CopyCommandLine: ["Copy as command line"], "Copy the command that trains this dataset with these settings without a window",
        [], Train 1, Window Dataset;
    Find: ["Find action…"], "Find any action by typing part of its name",
        [ctrl(Key::P)], Help 0, Window Nothing;
    FocusControls: ["Focus controls"], "Focus the controls (Tab for the next), or the view",
        [key(Key::F6)], Help 0, Window Nothing;
    Help: ["Shortcuts"], "Show all keyboard and mouse shortcuts",
        [key(Key::F1)], Help 0, Window Nothing;
    About: ["About"], "Show the version and the manual",
        [], Help 1, Window Nothing;
    Quit: ["Quit"], "Close the window; unsaved training must be confirmed",
        [ctrl(Key::Q)], Help 1, Window Nothing;
}

impl UiCommand {
    pub fn label(self) -> &'static str {
        self.row().names[0]
    }

    /// Returns the longer name, for places where no neighbouring button explains the label.
    pub fn full_name(self) -> &'static str {
        match self.row().names {
            [_, name] => name,
            _ => self.label().trim_end_matches('…'),
        }
    }

    pub fn tooltip(self) -> &'static str {
        self.row().tooltip
    }

    pub fn menu(self) -> (Menu, u8) {
        self.row().menu
    }

    pub fn is_view_command(self) -> bool {
        self.row().executor == Executor::View
    }

    pub fn is_available(self, state: RunState, source: Source) -> bool {
        use RunState::{Empty, Failed, Finished, Loading, Paused, Ready, Training, Waiting};
        let dataset = source == Source::Dataset;
        match self.row().needs {
            Needs::Nothing => true,
            Needs::NotLoading => state != Loading,
            Needs::Resting => dataset && matches!(state, Ready | Paused),
            Needs::Training => state == Training,
            Needs::Trained => dataset && matches!(state, Training | Paused | Finished | Failed),
            Needs::Scene => {
                source != Source::Nothing && !matches!(state, Empty | Loading | Waiting)
            }
            Needs::Dataset => dataset,
            Needs::Model => source != Source::Nothing,
        }
    }

    pub fn unavailable_reason(self, state: RunState, source: Source) -> Option<&'static str> {
        if self.is_available(state, source) {
            return None;
        }
        let is_for = |source| RunState::ALL.iter().any(|&state| self.is_available(state, source));
        Some(match (state, source) {
            // First, because the source is still that of the subject opened before.
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

    pub fn shortcuts(self) -> &'static [KeyboardShortcut] {
        self.row().keys
    }

    /// Returns the shortcuts as shown in menus; empty if the command has none.
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

    /// True if one of the command's shortcuts also acts on a focused control: presses the control, changes
    /// its value or moves the focus.
    pub fn conflicts_with_controls(self) -> bool {
        // egui handles these keys itself while a control has the focus.
        const KEYS: [Key; 5] = [Key::Space, Key::Tab, Key::ArrowLeft, Key::ArrowRight, Key::Escape];
        self.shortcuts().iter().any(|shortcut| KEYS.contains(&shortcut.logical_key))
    }

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
