//! Layout of the window's panels, stored between sessions.
//!
//! Panels and viewport are tiles of one tree, so panels can be docked on any side. The viewport tile cannot
//! be dragged or become one of several tabs, so it is always visible. In containers that hold the viewport,
//! the shares of `egui_tiles` are sizes in points: when the window is resized, panels keep their size and
//! the viewport fills the rest.

use super::command::labelled;
use super::settings_file;
use eframe::egui::{Id, Vec2};
use egui_tiles::{Container, LinearDir, Tile, TileId, Tiles, Tree};
use serde::{Deserialize, Serialize};
use std::collections::{BTreeSet, HashMap, HashSet};

/// Version of the stored format; other versions are rejected.
const VERSION: u32 = 2;
const WIDTH: f32 = 370.0;
/// Initial fraction of the available length for panels newly docked beside the viewport.
const NEW_SHARE: f32 = 0.24;
/// Largest fraction of the available length for panels on one side of the viewport, and on both sides
/// together.
const MAX_SHARE: f32 = 0.42;
const MAX_SHARE_OF_BOTH: f32 = 0.6;
/// Smallest share that is interpreted as a size in points. A smaller share is replaced by the initial size.
// egui_tiles gives the children of a new container shares of 1.
const MIN_POINTS: f32 = 60.0;
/// Size that the panels may have even if it exceeds the largest fraction of the available length, points.
// The names of all tabs fit.
const MIN_WIDTH: f32 = 325.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum DockPane {
    Picture,
    Panel(SideTab),
}

impl DockPane {
    fn all() -> BTreeSet<Self> {
        SideTab::ALL.into_iter().map(Self::Panel).chain([Self::Picture]).collect()
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct WindowLayout {
    version: u32,
    pub shows_frames: bool,
    pub tree: Tree<DockPane>,
    /// Sizes of tiles that a small window has shrunk, points: the size before, and the shrunk one.
    #[serde(default)]
    shrunk: HashMap<TileId, [f32; 2]>,
}

impl Default for WindowLayout {
    /// Returns the default layout: viewport on the left, all panels as tabs on the right.
    fn default() -> Self {
        let mut tiles = Tiles::default();
        let picture = tiles.insert_pane(DockPane::Picture);
        let panels = SideTab::ALL.map(|tab| tiles.insert_pane(DockPane::Panel(tab)));
        let side = tiles.insert_tab_tile(panels.to_vec());
        let root = tiles.insert_horizontal_tile(vec![picture, side]);
        if let Some(Tile::Container(Container::Linear(linear))) = tiles.get_mut(root) {
            linear.shares.set_share(side, WIDTH);
        }
        let tree = Tree::new(Id::unique("dock"), root, tiles);
        Self { version: VERSION, shows_frames: true, tree, shrunk: HashMap::new() }
    }
}

impl WindowLayout {
    /// Parses a stored layout. Returns the default layout and a notice if the text is unreadable, of
    /// another version, or lacks a panel.
    pub fn from_text(text: &str) -> (Self, Option<String>) {
        let (read, notice) = settings_file::from_text::<Self>("the layout", text);
        let found = match &read {
            _ if notice.is_some() => return (read, notice),
            Self { version, .. } if *version != VERSION => format!("version {version}"),
            _ if !is_valid(&read.tree) => {
                "a layout that lacks a panel or holds one twice".to_owned()
            }
            _ => return (read, None),
        };
        let notice = format!(
            "the stored layout: expected version {VERSION} with every panel once, found {found}; the default is used instead"
        );
        (Self::default(), Some(notice))
    }

    /// True if the panel is not hidden behind another tab.
    pub fn is_active(&self, tab: SideTab) -> bool {
        let tiles = &self.tree.tiles;
        let Some(pane) = tiles.find_pane(&DockPane::Panel(tab)) else { return false };
        let parent = tiles.parent_of(pane).and_then(|parent| tiles.get_container(parent));
        !matches!(parent, Some(Container::Tabs(tabs)) if tabs.active != Some(pane))
    }

    pub fn activate(&mut self, tab: SideTab) {
        let is_it =
            |tile: &Tile<DockPane>| matches!(tile, Tile::Pane(DockPane::Panel(of)) if *of == tab);
        self.tree.make_active(|_, tile| is_it(tile));
    }

    /// Resizes the tiles to `size` (points). Panels keep their sizes, and get them back after a small window has
    /// shrunk them. The viewport fills the remaining space.
    pub fn resize(&mut self, size: Vec2, gap: f32) {
        let Some(mut child) = self.tree.tiles.find_pane(&DockPane::Picture) else { return };
        let mut path = Vec::new();
        while let Some(parent) = self.tree.tiles.parent_of(child) {
            path.push((parent, child));
            child = parent;
        }
        let mut room = size;
        for (parent, child) in path.into_iter().rev() {
            if let Some(Tile::Container(Container::Linear(linear))) =
                self.tree.tiles.get_mut(parent)
            {
                let is_wide = linear.dir == LinearDir::Horizontal;
                let length = if is_wide { &mut room.x } else { &mut room.y };
                let others: Vec<TileId> =
                    linear.children.iter().copied().filter(|&id| id != child).collect();
                let gaps = gap * others.len() as f32;
                let room = *length - gaps;
                *length = fit_shares(&mut linear.shares, &mut self.shrunk, child, &others, room);
            }
        }
    }
}

/// Sets the shares of a container in points. `others` keep their shares unless their sum exceeds the
/// limit; `child` fills the rest of `length`. Returns the share of `child`.
fn fit_shares(
    shares: &mut egui_tiles::Shares,
    shrunk: &mut HashMap<TileId, [f32; 2]>,
    child: TileId,
    others: &[TileId],
    length: f32,
) -> f32 {
    let mut sum = 0.0;
    for &other in others {
        // A tile that the user has resized since keeps its new size.
        if let Some([before, after]) = shrunk.remove(&other)
            && shares[other] == after
        {
            shares.set_share(other, before);
        }
        let share = shares[other];
        if !share.is_finite() || share < MIN_POINTS {
            shares.set_share(other, NEW_SHARE * length);
        }
        sum += shares[other];
    }
    let share = if others.len() > 1 { MAX_SHARE_OF_BOTH } else { MAX_SHARE };
    // In a very narrow window the least width gives way too, so that some viewport remains.
    let most = (share * length).max(MIN_WIDTH.min(0.6 * length)).max(0.0);
    if sum > most {
        for &other in others {
            let before = shares[other];
            shares[other] *= most / sum;
            shrunk.insert(other, [before, shares[other]]);
        }
        sum = most;
    }
    let rest = (length - sum).max(0.0);
    shares.set_share(child, rest);
    rest
}

/// True if the tree holds every pane exactly once, with the viewport visible and every tile reachable.
pub fn is_valid(tree: &Tree<DockPane>) -> bool {
    let Some(root) = tree.root() else { return false };
    let (mut seen, mut panes, mut waiting) = (HashSet::new(), BTreeSet::new(), vec![root]);
    while let Some(id) = waiting.pop() {
        // A visited set also detects cycles, in which egui would loop forever.
        if !seen.insert(id) {
            return false;
        }
        match tree.tiles.get(id) {
            None => return false,
            Some(Tile::Pane(pane)) if !panes.insert(*pane) || !tree.is_visible(id) => return false,
            Some(Tile::Pane(_)) => {}
            Some(Tile::Container(container)) => waiting.extend(container.children()),
        }
    }
    panes == DockPane::all() && !is_picture_hideable(tree)
}

/// True if the viewport is one of several tabs, so that another tab can hide it.
fn is_picture_hideable(tree: &Tree<DockPane>) -> bool {
    let picture = tree.tiles.find_pane(&DockPane::Picture);
    let ancestors = std::iter::successors(picture, |&id| tree.tiles.parent_of(id)).skip(1);
    let mut containers = ancestors.filter_map(|id| tree.tiles.get_container(id));
    containers.any(|container| match container {
        Container::Tabs(tabs) => tabs.children.len() > 1,
        Container::Linear(_) | Container::Grid(_) => false,
    })
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
pub enum SideTab {
    Summary,
    Quality,
    Latency,
    Inspector,
    Edit,
    Path,
    Settings,
}

labelled! { SideTab:
    Summary: "Summary", "What is open, how good the scene is, and what can be done next";
    Quality: "Quality", "Errors of views that were not trained, over time and by view";
    Latency: "Latency", "Times of training and drawing by stage";
    Inspector: "Inspector", "The selected splat and its posterior";
    Edit: "Edit", "Selection, deletion, crop box, history";
    Path: "Path", "Camera paths and films";
    Settings: "Settings", "Training, drawing, graphics adapter, layout";
}

#[cfg(test)]
mod tests {
    use super::*;

    fn width_of(layout: &WindowLayout, pane: DockPane) -> f32 {
        let tiles = &layout.tree.tiles;
        let mut id = tiles.find_pane(&pane).unwrap();
        loop {
            let parent = tiles.parent_of(id).unwrap();
            match tiles.get_container(parent).unwrap() {
                Container::Linear(linear) => return linear.shares[id],
                _ => id = parent,
            }
        }
    }

    #[test]
    fn layouts_survive_a_restart() {
        let mut layout = WindowLayout { shows_frames: false, ..WindowLayout::default() };
        layout.activate(SideTab::Inspector);
        layout.resize(Vec2::new(1000.0, 600.0), 0.0);
        let (read, notice) = WindowLayout::from_text(&ron::to_string(&layout).unwrap());
        assert_eq!((read, notice), (layout, None));
    }

    #[test]
    fn broken_and_older_layouts_fall_back_and_say_so() {
        let good = WindowLayout::default();
        let older = WindowLayout { version: 0, ..good.clone() };
        let mut lacking = good.clone();
        let inspector = DockPane::Panel(SideTab::Inspector);
        let id = lacking.tree.tiles.find_pane(&inspector).unwrap();
        lacking.tree.remove_recursively(id);
        let mut twice = good.clone();
        let root = twice.tree.root().unwrap();
        let again = twice.tree.tiles.insert_pane(inspector);
        twice.tree.move_tile_to_container(again, root, 0, false);
        let mut buried = good.clone();
        let picture = buried.tree.tiles.find_pane(&DockPane::Picture).unwrap();
        let id = buried.tree.tiles.find_pane(&inspector).unwrap();
        let tabs = buried.tree.tiles.parent_of(id).unwrap();
        buried.tree.move_tile_to_container(picture, tabs, 0, false);
        let mut circle = good.clone();
        if let Some(Tile::Container(Container::Linear(root))) = circle.tree.tiles.get_mut(root) {
            let own = circle.tree.root.unwrap();
            root.children.push(own);
        }
        let mut texts: Vec<String> =
            [older, lacking, twice, buried, circle].map(|l| ron::to_string(&l).unwrap()).into();
        texts.extend(["", "(version: 1)", "no RON at all"].map(str::to_owned));
        for text in texts {
            let (read, notice) = WindowLayout::from_text(&text);
            assert_eq!(read, good, "{text}");
            assert!(notice.is_some_and(|notice| notice.contains("used instead")), "{text}");
        }
    }

    #[test]
    fn panels_keep_their_width_and_the_picture_takes_the_rest() {
        let mut layout = WindowLayout::default();
        let panel = DockPane::Panel(SideTab::Quality);
        let mut widths = vec![(1280.0, 370.0), (2000.0, 370.0), (700.0, 325.0), (600.0, 325.0)];
        // A small window shrinks panels only as long as it is small.
        widths.extend([(500.0, 300.0), (700.0, 325.0), (1280.0, 370.0)]);
        for (width, expected) in widths {
            layout.resize(Vec2::new(width, 600.0), 0.0);
            assert_eq!(width_of(&layout, panel), expected, "{width}");
            assert_eq!(width_of(&layout, DockPane::Picture), width - expected, "{width}");
        }
        // A size chosen in a small window stays.
        let root = layout.tree.root().unwrap();
        layout.resize(Vec2::new(500.0, 600.0), 0.0);
        let side =
            layout.tree.tiles.find_pane(&panel).and_then(|id| layout.tree.tiles.parent_of(id));
        if let Some(Tile::Container(Container::Linear(linear))) = layout.tree.tiles.get_mut(root) {
            linear.shares.set_share(side.unwrap(), 200.0);
        }
        layout.resize(Vec2::new(1280.0, 600.0), 0.0);
        assert_eq!(width_of(&layout, panel), 200.0);
        // As after docking a panel on the other side of the viewport.
        let id = layout.tree.tiles.find_pane(&panel).unwrap();
        layout.tree.move_tile_to_container(id, root, 0, false);
        layout.resize(Vec2::new(2000.0, 600.0), 0.0);
        assert_eq!(width_of(&layout, panel), NEW_SHARE * 2000.0);
        let others = width_of(&layout, DockPane::Panel(SideTab::Summary));
        assert_eq!(width_of(&layout, DockPane::Picture), 2000.0 - others - NEW_SHARE * 2000.0);
    }
}
