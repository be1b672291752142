//! Keyboard shortcuts of commands, and their names.

use super::command::UiCommand;
use eframe::egui::{Context, Key, KeyboardShortcut, Modifiers};

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
