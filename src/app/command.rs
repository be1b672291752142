//! What a user can ask for: label, tooltip and shortcut in one place, and the one table of what is
//! legal in which state. Buttons, keys and the help list come from here.

use super::state::{RunState, Source};
use eframe::egui::{Context, Key, KeyboardShortcut, Modifiers};

/// A request of the user.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Command {
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
    /// Start over with the same dataset.
    Reset,
    /// Write the run to a file it can go on from.
    Save,
    /// Write the scene to a file.
    Export,
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
    /// Compare with the photograph, or stop doing so.
    ComparePhoto,
    /// Select no splat any more.
    Deselect,
    /// List of all shortcuts.
    Help,
}

impl Command {
    /// Every command, in the order help shows them.
    pub const ALL: [Command; 16] = [
        Command::Open,
        Command::OpenDemo,
        Command::Train,
        Command::Pause,
        Command::Step,
        Command::Reset,
        Command::Save,
        Command::Export,
        Command::FrameScene,
        Command::Home,
        Command::ToggleRenderer,
        Command::PreviousCamera,
        Command::NextCamera,
        Command::ComparePhoto,
        Command::Deselect,
        Command::Help,
    ];

    /// Text on the button.
    pub fn label(self) -> &'static str {
        match self {
            Command::Open => "Open…",
            Command::OpenDemo => "Demo",
            Command::Train => "Train",
            Command::Pause => "Pause",
            Command::Step => "Step",
            Command::Reset => "Reset",
            Command::Save => "Save…",
            Command::Export => "Export…",
            Command::FrameScene => "Frame scene",
            Command::Home => "Home view",
            Command::ToggleRenderer => "Projected/exact",
            Command::PreviousCamera => "‹",
            Command::NextCamera => "›",
            Command::ComparePhoto => "Photograph",
            Command::Deselect => "Deselect",
            Command::Help => "Shortcuts",
        }
    }

    /// One sentence on what it does.
    pub fn tooltip(self) -> &'static str {
        match self {
            Command::Open => "Open a dataset folder, a checkpoint, a .ply or a .glb",
            Command::OpenDemo => "Train the built-in synthetic scene",
            Command::Train => "Train frame by frame until the frames end",
            Command::Pause => "Stop after the current frame",
            Command::Step => "Train exactly one frame",
            Command::Reset => "Forget the scene and start over with what was opened",
            Command::Save => "Write a checkpoint that training can go on from",
            Command::Export => "Write the scene as .ply or .glb",
            Command::FrameScene => "Move the camera so that the whole scene is seen",
            Command::Home => "Go back to the view the scene was opened with",
            Command::ToggleRenderer => "Switch between the projected and the exact renderer",
            Command::PreviousCamera => "Stand where the dataset's camera before stood",
            Command::NextCamera => "Stand where the dataset's next camera stood",
            Command::ComparePhoto => "Compare with the photograph at a dataset's camera, or stop",
            Command::Deselect => "Select no splat any more; a click on a splat selects it",
            Command::Help => "Show all keyboard and mouse shortcuts",
        }
    }

    /// Keys that ask for it.
    pub fn shortcuts(self) -> &'static [KeyboardShortcut] {
        const fn plain(key: Key) -> KeyboardShortcut {
            KeyboardShortcut::new(Modifiers::NONE, key)
        }
        const fn control(key: Key) -> KeyboardShortcut {
            KeyboardShortcut::new(Modifiers::COMMAND, key)
        }
        match self {
            Command::Open => const { &[control(Key::O)] },
            Command::OpenDemo => &[],
            // One key toggles the two, of which one is legal at a time.
            Command::Train | Command::Pause => const { &[plain(Key::Space)] },
            Command::Step => const { &[plain(Key::Period)] },
            Command::Reset => const { &[control(Key::R)] },
            Command::Save => const { &[control(Key::S)] },
            Command::Export => const { &[control(Key::E)] },
            Command::FrameScene => const { &[plain(Key::F)] },
            Command::Home => const { &[plain(Key::H)] },
            Command::ToggleRenderer => const { &[plain(Key::Tab)] },
            Command::PreviousCamera => const { &[plain(Key::OpenBracket), plain(Key::ArrowLeft)] },
            Command::NextCamera => const { &[plain(Key::CloseBracket), plain(Key::ArrowRight)] },
            Command::ComparePhoto => const { &[plain(Key::G)] },
            Command::Deselect => const { &[plain(Key::Escape)] },
            Command::Help => const { &[plain(Key::F1)] },
        }
    }

    /// Its keys as menus show them, empty if it has none.
    pub fn keys(self, ctx: &Context) -> String {
        let name = |shortcut: &KeyboardShortcut| {
            // `[` says more than its name; other symbols, as of arrows, are in none of the fonts.
            let symbol = shortcut.logical_key.symbol_or_name();
            match shortcut.modifiers {
                Modifiers::NONE if symbol.is_ascii() => symbol.to_owned(),
                _ => ctx.format_shortcut(shortcut),
            }
        };
        self.shortcuts().iter().map(name).collect::<Vec<_>>().join(" or ")
    }

    /// What it does and its keys.
    pub fn hint(self, ctx: &Context) -> String {
        match self.shortcuts() {
            [] => self.tooltip().to_owned(),
            _ => format!("{} ({})", self.tooltip(), self.keys(ctx)),
        }
    }

    /// Whether the command makes sense now: the one table of states and commands.
    pub fn is_legal(self, state: RunState, source: Source) -> bool {
        use RunState::{Empty, Failed, Finished, Loading, Paused, Ready, Training};
        let dataset = source == Source::Dataset;
        match self {
            Command::Open | Command::OpenDemo => state != Loading,
            Command::Train => dataset && matches!(state, Ready | Paused),
            Command::Pause => state == Training,
            Command::Step => dataset && matches!(state, Ready | Paused),
            Command::Reset | Command::Save => {
                dataset && matches!(state, Training | Paused | Finished | Failed)
            }
            Command::Export => source != Source::Nothing && !matches!(state, Empty | Loading),
            Command::FrameScene | Command::Home | Command::ToggleRenderer | Command::Deselect => {
                source != Source::Nothing
            }
            Command::PreviousCamera | Command::NextCamera | Command::ComparePhoto => dataset,
            Command::Help => true,
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
                assert!(Command::ALL.iter().any(|c| c.is_legal(state, source)));
                let both = Command::Train.is_legal(state, source)
                    && Command::Pause.is_legal(state, source);
                assert!(!both, "{state:?}");
            }
        }
        assert!(!Command::Train.is_legal(RunState::Finished, Source::Dataset));
        assert!(!Command::Reset.is_legal(RunState::Finished, Source::Model));
        assert!(
            Command::Export.is_legal(RunState::Failed, Source::Dataset),
            "a trained scene stays usable"
        );
    }
}
