//! Choice of the graphics adapter.

use crate::render::gpu::adapters::{AdapterChoice, AdapterInfo};
use eframe::egui::{Label, RichText, Ui};

pub struct Adapters<'a> {
    /// Adapters that can draw the window.
    pub there: &'a [AdapterInfo],
    /// Adapter in use.
    pub current: &'a AdapterInfo,
    /// True if the CPU draws the scene because the GPU failed.
    pub gpu_failed: bool,
}

#[derive(Clone, Debug, PartialEq, Eq)]
pub enum AdapterRequest {
    /// Reopen the window on another adapter.
    Adapter(AdapterChoice),
    /// Retry drawing on the current GPU.
    RetryGpu,
}

pub fn ui(adapters: &Adapters, ui: &mut Ui) -> Option<AdapterRequest> {
    let mut asked = None;
    ui.label(RichText::new("Graphics adapter").strong());
    let switch = "Reopens the window on this adapter; training continues";
    for adapter in adapters.there {
        let is_current = adapters.current == adapter;
        let name = adapter.to_string();
        let clicked = ui.selectable_label(is_current, &name).on_hover_text(switch).clicked();
        if clicked && !is_current {
            // By name, not by index: the choice is stored for the next start, when the list may differ.
            asked = Some(AdapterRequest::Adapter(AdapterChoice::Named(name)));
        }
    }
    if ui.button("Choose automatically").on_hover_text(switch).clicked() {
        asked = Some(AdapterRequest::Adapter(AdapterChoice::Auto));
    }
    if adapters.gpu_failed {
        ui.add(Label::new("The GPU failed, so the CPU draws the scene.").wrap());
        if ui.button("Retry GPU").on_hover_text("Reinitialises drawing on the GPU").clicked() {
            asked = Some(AdapterRequest::RetryGpu);
        }
    }
    asked
}
