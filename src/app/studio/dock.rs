//! Docking of panels and viewport: tiles that the user rearranges by dragging tabs.

use super::Studio;
use crate::app::layout::{DockPane, WindowLayout, is_valid};
use crate::app::state::{NoticeOffer, Snapshot};
use crate::app::viewer::toolbar;
use eframe::egui::containers::panel::PanelState;
use eframe::egui::{
    Align2, CentralPanel, Color32, Context, CursorIcon, Frame, Id, LayerId, Margin, Order, Painter,
    Panel, Rect, Response, Role, Sense, Stroke, StrokeKind, Style, TextStyle, TextWrapMode, Ui,
    UiBuilder, Vec2, Visuals, WidgetInfo, WidgetText,
};
use egui_tiles::{
    Behavior, EditAction, ResizeState, SimplificationOptions, TabState, Tabs, TileId, Tiles, Tree,
    UiResponse,
};

const GAP: f32 = 1.0;
/// Minimum size of a panel resized by dragging, points.
const MIN_SIZE: f32 = 120.0;
/// Margins of a panel's contents and of a tab's title, points.
const MARGIN: Margin = Margin { left: 8, right: 8, top: 4, bottom: 2 };
const TAB_MARGIN: Vec2 = Vec2::new(6.0, 2.0);
/// Minimum margin of a tab's title in a narrow panel, points.
const MIN_TAB_MARGIN: f32 = 2.0;

struct Dock<'a> {
    studio: &'a mut Studio,
    snapshot: &'a Snapshot,
    picture: Option<TileId>,
    /// Rectangle of the viewport. The viewport is drawn after the panels, so that changes made in panels
    /// apply at once.
    picture_rect: Option<Rect>,
    is_dropped: bool,
    tab_margin: Vec2,
}

impl Dock<'_> {
    fn holds_picture(&self, tiles: &Tiles<DockPane>, id: TileId) -> bool {
        let is_it = |id: TileId| self.picture == Some(id);
        is_it(id) || self.picture.and_then(|picture| tiles.parent_of(picture)) == Some(id)
    }
}

impl Behavior<DockPane> for Dock<'_> {
    fn pane_ui(&mut self, ui: &mut Ui, _: TileId, pane: &mut DockPane) -> UiResponse {
        match *pane {
            DockPane::Picture => self.picture_rect = Some(ui.max_rect()),
            DockPane::Panel(tab) => {
                let content = Frame::NONE.inner_margin(MARGIN);
                content.show(ui, |ui| self.studio.panel(tab, ui, self.snapshot));
            }
        }
        UiResponse::None
    }

    fn tab_title_for_pane(&mut self, pane: &DockPane) -> WidgetText {
        match pane {
            DockPane::Picture => "Picture".into(),
            DockPane::Panel(tab) => tab.label().into(),
        }
    }

    /// Draws a tab in the style of the window's other selectable buttons.
    fn tab_ui(
        &mut self,
        tiles: &mut Tiles<DockPane>,
        ui: &mut Ui,
        id: Id,
        tile: TileId,
        state: &TabState,
    ) -> Response {
        let title = self.tab_title_for_tile(tiles, tile);
        let font = TextStyle::Button.resolve(ui.style());
        let text = title.into_galley(ui, Some(TextWrapMode::Extend), f32::INFINITY, font);
        let size = text.size() + 2.0 * self.tab_margin;
        let (_, place) = ui.allocate_space(Vec2::new(size.x, ui.available_height()));
        let rect = Align2::CENTER_CENTER.align_size_within_rect(size, place);
        let response = ui.interact(rect, id, Sense::click_and_drag());
        let is_enabled = ui.is_enabled();
        response.widget_info(|| {
            WidgetInfo::selected(Role::Button, is_enabled, state.active, text.text())
        });
        let look = ui.style().interact_selectable(&response, state.active);
        if state.active || response.hovered() || response.has_focus() {
            let (radius, stroke) = (look.corner_radius, look.bg_stroke);
            ui.painter().rect(rect, radius, look.weak_bg_fill, stroke, StrokeKind::Inside);
        }
        ui.painter().galley(rect.min + self.tab_margin, text, look.text_color());
        let hint =
            "Drag to dock it next to the viewport, next to other panels, or among their tabs";
        response.on_hover_cursor(CursorIcon::Grab).on_hover_text(hint)
    }

    /// Reduces the margins of tab titles in a narrow panel before egui_tiles hides tabs behind an arrow.
    fn tab_bar_left_ui(&mut self, tiles: &Tiles<DockPane>, ui: &mut Ui, _: TileId, tabs: &Tabs) {
        // Aligns the first title with the panel's contents.
        ui.add_space(f32::from(MARGIN.left) - TAB_MARGIN.x);
        let font = TextStyle::Button.resolve(ui.style());
        let width = |tab: &TileId| {
            let title = self.tab_title_for_tile(tiles, *tab);
            title.into_galley(ui, Some(TextWrapMode::Extend), f32::INFINITY, font.clone()).size().x
        };
        let names: f32 = tabs.children.iter().map(width).sum();
        let room = (ui.available_width() - names) / (2.0 * tabs.children.len().max(1) as f32);
        // Rounded down, so that tabs still fit when aligned to whole pixels.
        self.tab_margin.x = room.floor().clamp(MIN_TAB_MARGIN, TAB_MARGIN.x);
    }

    fn is_tile_draggable(&self, tiles: &Tiles<DockPane>, id: TileId) -> bool {
        !self.holds_picture(tiles, id)
    }

    fn is_tab_bar_visible(&self, _: TileId, tabs: &Tabs) -> bool {
        !self.picture.is_some_and(|picture| tabs.children.contains(&picture))
    }

    fn simplification_options(&self) -> SimplificationOptions {
        // A single panel keeps its tab, which shows its name and is its drag handle.
        SimplificationOptions { all_panes_must_have_tabs: true, ..Default::default() }
    }

    fn tab_bar_color(&self, _: &Visuals) -> Color32 {
        // Transparent, since the window is already cleared to the panels' colour.
        Color32::TRANSPARENT
    }

    fn gap_width(&self, _: &Style) -> f32 {
        GAP
    }

    fn min_size(&self) -> f32 {
        MIN_SIZE
    }

    fn resize_stroke(&self, style: &Style, state: ResizeState) -> Stroke {
        match state {
            ResizeState::Idle => style.visuals.widgets.noninteractive.bg_stroke,
            ResizeState::Hovering => style.visuals.widgets.hovered.fg_stroke,
            ResizeState::Dragging => style.visuals.widgets.active.fg_stroke,
        }
    }

    /// Draws the preview of a dragged panel in the foreground, because the viewport is drawn after the
    /// tiles.
    fn paint_drag_preview(
        &self,
        visuals: &Visuals,
        painter: &Painter,
        _: Option<Rect>,
        preview: Rect,
    ) {
        let layer = LayerId::new(Order::Foreground, Id::unique("dock preview"));
        let painter = painter.ctx().layer_painter(layer);
        let (fill, stroke) = (self.drag_preview_color(visuals), self.drag_preview_stroke(visuals));
        painter.rect(preview, 1.0, fill, stroke, StrokeKind::Inside);
    }

    fn on_edit(&mut self, action: EditAction) {
        self.is_dropped |= action == EditAction::TileDropped;
    }
}

pub(super) fn tiles(studio: &mut Studio, ui: &mut Ui, frame: Frame, snapshot: &Snapshot) {
    studio.layout.resize(ui.available_size(), GAP);
    let before = studio.layout.tree.clone();
    // Taken out, because drawing a panel needs the whole window.
    let nothing = Tree::empty(before.id());
    let mut tree = std::mem::replace(&mut studio.layout.tree, nothing);
    let picture = tree.tiles.find_pane(&DockPane::Picture);
    let mut dock = Dock {
        studio: &mut *studio,
        snapshot,
        picture,
        picture_rect: None,
        is_dropped: false,
        tab_margin: TAB_MARGIN,
    };
    tree.ui(&mut dock, ui);
    let Dock { picture_rect: place, is_dropped, .. } = dock;
    // A panel dropped on the middle of the viewport would hide it behind a tab.
    studio.layout.tree = if is_dropped && !is_valid(&tree) { before } else { tree };
    let Some(place) = place else { return };
    let mut ui = ui.new_child(UiBuilder::new().max_rect(place).id_salt("picture"));
    // The viewport must not paint over the panels beside it.
    ui.set_clip_rect(place);
    viewport(studio, &mut ui, frame, snapshot);
}

fn viewport(studio: &mut Studio, ui: &mut Ui, frame: Frame, snapshot: &Snapshot) {
    if let Some(opened) = &snapshot.opened {
        let asked = Panel::top("viewport bar").frame(frame).show(ui, |ui| {
            ui.add_space(2.0);
            let asked = toolbar::ui(&mut studio.view, snapshot, opened, ui);
            ui.add_space(2.0);
            asked
        });
        if let Some(command) = asked.inner {
            studio.apply_command(command, snapshot);
        }
    }
    // The central panel comes last: egui gives it the room left by the others.
    CentralPanel::default().frame(Frame::NONE).show(ui, |ui| {
        let (noticed, taken) = studio.panels.notices.ui(snapshot, ui);
        match taken {
            None => {}
            Some(NoticeOffer::OpenAs(open_as)) => studio.dialogs.open_as(open_as),
            Some(NoticeOffer::OpenAbove(above)) => studio.open_path(above, snapshot),
        }
        studio.central_view(ui, snapshot, noticed);
    });
}

pub(super) fn reset_layout(layout: &mut WindowLayout, egui: &Context) {
    *layout = WindowLayout::default();
    // egui stores the sizes of the panels around the tiles.
    egui.data_mut(|data| data.remove_by_type::<PanelState>());
}
