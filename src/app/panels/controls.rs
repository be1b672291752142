//! Controls shared by the panels: buttons of commands, choices, numbers, and headings.

use crate::app::command::UiCommand;
use crate::app::fonts::icon;
use eframe::egui::emath::Numeric;
use eframe::egui::{
    Button, Color32, DragValue, Label, Response, RichText, Role, Sense, Ui, Vec2, WidgetInfo,
};
use std::ops::RangeInclusive;

/// Size of the space for the dot that marks a changed setting, points.
// Reserved without a dot too, so that nothing moves when one appears.
const SIZE: Vec2 = Vec2::splat(12.0);

/// Draws a dot if a setting differs from its default. Returns true if the dot is clicked.
pub fn reset_dot(name: &str, default: &str, differs: bool, ui: &mut Ui) -> bool {
    if !differs {
        ui.allocate_exact_size(SIZE, Sense::hover());
        return false;
    }
    let (rect, response) = ui.allocate_exact_size(SIZE, Sense::click());
    let is_hot = response.hovered() || response.has_focus();
    let dot = ui.visuals().selection.bg_fill.lerp_to_gamma(Color32::WHITE, 0.25);
    ui.painter().circle_filled(rect.center(), if is_hot { 5.0 } else { 3.5 }, dot);
    let text = format!("{name}: reset to {default}");
    response.widget_info(|| WidgetInfo::labeled(Role::Button, true, &text));
    response.on_hover_text(format!("Changed. Click to reset to {default}")).clicked()
}

/// Width of a slider that has a label before and a button behind it, points.
pub const SLIDER: f32 = 150.0;

/// Draws the button of a command. If `why_not` contains a reason, the button is disabled. Returns true if
/// it is clicked.
pub fn command_button(command: UiCommand, is_on: bool, why_not: Option<&str>, ui: &mut Ui) -> bool {
    let icon = match command {
        UiCommand::Train => Some(icon::TRAIN),
        UiCommand::Pause => Some(icon::PAUSE),
        _ => None,
    };
    let button = match icon {
        Some(icon) => Button::new((icon, command.label())),
        None => Button::new(command.label()),
    };
    let button = add_button(button.selected(is_on), &command.hint(ui.ctx()), why_not, ui);
    named(button, command.label()).clicked()
}

/// Draws an entry of a menu, which closes the menu. If `why_not` contains a reason, the entry is disabled.
/// Returns true if it is clicked.
pub fn entry(is_on: bool, [label, tooltip]: [&str; 2], why_not: Option<&str>, ui: &mut Ui) -> bool {
    entry_with_keys(is_on, [label, "", tooltip], why_not, ui)
}

/// Draws an entry of a menu as [`entry`] does, with its shortcut after the label.
pub fn entry_with_keys(
    is_on: bool,
    [label, keys, tooltip]: [&str; 3],
    why_not: Option<&str>,
    ui: &mut Ui,
) -> bool {
    let button = Button::selectable(is_on, label);
    // Screen readers would announce an empty shortcut as part of the name.
    let button = if keys.is_empty() { button } else { button.shortcut_text(keys) };
    let is_chosen = button_or_reason(button, tooltip, why_not, ui);
    if is_chosen {
        ui.close();
    }
    is_chosen
}

/// Draws a button. If `why_not` contains a reason, the button is disabled and the reason replaces the
/// tooltip. Returns true if the button is clicked.
pub fn button_or_reason(
    button: Button<'_>,
    tooltip: &str,
    why_not: Option<&str>,
    ui: &mut Ui,
) -> bool {
    add_button(button, tooltip, why_not, ui).clicked()
}

fn add_button(button: Button<'_>, tooltip: &str, why_not: Option<&str>, ui: &mut Ui) -> Response {
    let button = ui.add_enabled(why_not.is_none(), button).on_hover_text(tooltip);
    button.on_disabled_hover_text(why_not.unwrap_or_default())
}

/// Draws one button for each choice (value, label and tooltip). Returns true if one is clicked.
pub fn choices<T: PartialEq + Copy>(chosen: &mut T, all: &[(T, &str, &str)], ui: &mut Ui) -> bool {
    let mut is_clicked = false;
    for &(value, label, tooltip) in all {
        let button = ui.selectable_value(chosen, value, label);
        let button = if tooltip.is_empty() { button } else { button.on_hover_text(tooltip) };
        is_clicked |= button.clicked();
    }
    is_clicked
}

/// Draws a number and a checkbox that switches it on. Both have an accessible name.
pub fn optional_number<T: Numeric>(
    value: &mut Option<T>,
    default: T,
    range: RangeInclusive<T>,
    [label, help, name, suffix]: [&str; 4],
    ui: &mut Ui,
) {
    ui.horizontal(|ui| {
        let mut is_on = value.is_some();
        if ui.checkbox(&mut is_on, label).on_hover_text(help).changed() {
            *value = is_on.then_some(default);
        }
        let mut shown = value.unwrap_or(default);
        let number = DragValue::new(&mut shown).range(range).suffix(suffix);
        if named(ui.add_enabled(is_on, number), name).changed() {
            *value = Some(shown);
        }
    });
}

/// Sets the accessible name of a control whose visible label is elsewhere.
pub fn named(control: Response, name: &str) -> Response {
    control.ctx.accesskit_node_builder(control.id, |node| node.set_label(name));
    control
}

pub fn section(title: &str, ui: &mut Ui) {
    ui.add_space(8.0);
    ui.label(RichText::new(title).strong());
}

pub fn weak(ui: &mut Ui, text: &str) {
    ui.add(Label::new(RichText::new(text).weak()).wrap());
}
