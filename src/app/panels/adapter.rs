//! Which graphics adapter draws, and what else there is.

use crate::render::gpu::adapters::{AdapterChoice, AdapterFacts};
use eframe::egui::{Label, RichText, Ui};

/// What the panel shows.
pub struct Adapters<'a> {
    /// Everything that could draw the window.
    pub there: &'a [AdapterFacts],
    /// The one that does.
    pub current: &'a AdapterFacts,
    /// Whether the scene is drawn on the CPU because the GPU failed.
    pub gpu_failed: bool,
}

/// What the user asks for.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AdapterRequest {
    /// A new window on another adapter.
    Adapter(AdapterChoice),
    /// Another try with the GPU of this window.
    RetryGpu,
}

/// Draws the panel.
pub fn ui(adapters: &Adapters, ui: &mut Ui) -> Option<AdapterRequest> {
    let mut asked = None;
    ui.label(RichText::new("Graphics adapter").strong());
    let switch = "Closes this window and opens one on this adapter; training goes on meanwhile";
    for adapter in adapters.there {
        let is_current = adapters.current == adapter;
        let name = adapter.to_string();
        let clicked = ui.selectable_label(is_current, &name).on_hover_text(switch).clicked();
        if clicked && !is_current {
            // By name and not by place: it is kept for the next start, when others may be listed.
            asked = Some(AdapterRequest::Adapter(AdapterChoice::Named(name)));
        }
    }
    if ui.button("Choose automatically").on_hover_text(switch).clicked() {
        asked = Some(AdapterRequest::Adapter(AdapterChoice::Auto));
    }
    if adapters.gpu_failed {
        ui.add(Label::new("The GPU failed, so the CPU draws the scene.").wrap());
        if ui.button("Retry GPU").on_hover_text("Builds everything on the GPU again").clicked() {
            asked = Some(AdapterRequest::RetryGpu);
        }
    }
    asked
}
