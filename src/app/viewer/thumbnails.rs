//! Thumbnails of photographs and depth, stored as textures. Training makes those of the frames that it
//! decodes; others are decoded lazily in the background.
//!
//! Their number is bounded, so that memory does not grow with the dataset: the least recently used one
//! that is not on screen is dropped. During training, decoding pauses between frames and does not wake the
//! window, which repaints anyway.

use super::frame_refs::FrameRef;
use crate::app::panels::signal_color::to_color32;
use crate::app::state::Opened;
use crate::app::view_thread::{RestingJob, one_thread};
use crate::app::worker::Waker;
use crate::dataset::depth::Depth;
use crate::dataset::frame::Frame;
use crate::eval::report::quantile;
use crate::math::image::Image;
use crate::render::finish::ramp;
use eframe::egui::{Color32, ColorImage, Context, TextureHandle, TextureOptions};
use rayon::ThreadPool;
use std::collections::{HashMap, VecDeque};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

/// Maximum length of the longer side of a thumbnail, pixels.
pub const MAX_SIDE: usize = 192;
/// Maximum number of frames whose thumbnails are stored. A frame takes about 220 kB.
// Enough for the cameras in the viewport, a strip across a wide screen and a table of views.
const MAX_KEPT: usize = 256;
/// Maximum number of thumbnails of trained frames that wait for the window.
const MAX_WAITING: usize = 64;
/// Number of pixels per side of a block that are averaged: at most, and during training, which has other work.
const SAMPLES: usize = 8;
const FEW_SAMPLES: usize = 2;
/// Number of depths from which the range of colours is estimated, at most.
const RANGE_SAMPLES: usize = 2048;
/// Colour of pixels without a depth measurement.
const HOLE: Color32 = Color32::from_gray(18);

/// Pictures to decode from a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Part {
    Photo,
    PhotoAndDepth,
}

/// Pictures of a frame, or the reason why some are missing.
pub struct Pictures<T> {
    pub photo: Option<T>,
    /// Depth in colours from violet (near) to yellow (far), scaled to the depth range of the frame.
    pub depth: Option<T>,
    pub problem: Option<String>,
}

struct StoredThumbnails {
    /// Pictures requested so far.
    part: Part,
    /// Number of the latest egui pass that used the thumbnails.
    used_in: u64,
    /// Decoded pictures; `None` until decoded.
    pictures: Option<Pictures<TextureHandle>>,
}

pub struct Thumbnails {
    decoder: RestingJob<(usize, usize), Pictures<ColorImage>>,
    /// Pool of one thread, so that decoding does not use all cores.
    alone: Arc<ThreadPool>,
    kept: HashMap<(usize, usize), StoredThumbnails>,
    yields_cores: Arc<AtomicBool>,
    waker: Waker,
}

/// Thumbnails of frames that training has decoded, until the window takes them.
#[derive(Default)]
pub struct TrainedThumbnails(Mutex<VecDeque<TrainedThumbnail>>);

pub struct TrainedThumbnail {
    /// Serial number of the dataset.
    serial: u64,
    /// Position of the frame in the plan.
    position: usize,
    pictures: Pictures<ColorImage>,
}

impl TrainedThumbnails {
    /// Adds the thumbnails of a frame. The oldest are dropped if the window takes none, because it is hidden.
    pub fn add(&self, serial: u64, position: usize, frame: &Frame) {
        let pictures = pictures_of(&frame.color, frame.depth.as_ref(), FEW_SAMPLES, None);
        let mut waiting = self.lock();
        if waiting.len() == MAX_WAITING {
            waiting.pop_front();
        }
        waiting.push_back(TrainedThumbnail { serial, position, pictures });
    }

    fn take(&self) -> VecDeque<TrainedThumbnail> {
        std::mem::take(&mut self.lock())
    }

    fn lock(&self) -> MutexGuard<'_, VecDeque<TrainedThumbnail>> {
        // Every change is complete before anything can panic.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Thumbnails {
    pub fn start(waker: Waker) -> std::io::Result<Self> {
        let yields_cores = Arc::new(AtomicBool::new(false));
        let flag = yields_cores.clone();
        let wake_at_rest = move || {
            // Relaxed: no other memory depends on the flag.
            if !flag.load(Ordering::Relaxed) {
                waker();
            }
        };
        Ok(Self {
            decoder: RestingJob::default(),
            alone: Arc::new(one_thread()?),
            kept: HashMap::new(),
            yields_cores,
            waker: Arc::new(wake_at_rest),
        })
    }

    pub fn set_yields_cores(&self, yields: bool) {
        // Relaxed: no other memory depends on the flag.
        self.yields_cores.store(yields, Ordering::Relaxed);
    }

    /// Returns the thumbnail of a photograph if it is decoded. Otherwise requests it if `may_decode` is
    /// true.
    pub fn get(
        &mut self,
        context: &Context,
        frame: &FrameRef,
        may_decode: bool,
    ) -> Option<&TextureHandle> {
        self.look_up(context, frame, may_decode.then_some(Part::Photo))?.photo.as_ref()
    }

    pub fn pictures(
        &mut self,
        context: &Context,
        frame: &FrameRef,
    ) -> Option<&Pictures<TextureHandle>> {
        self.look_up(context, frame, Some(Part::PhotoAndDepth))
    }

    fn look_up(
        &mut self,
        context: &Context,
        frame: &FrameRef,
        wanted: Option<Part>,
    ) -> Option<&Pictures<TextureHandle>> {
        self.take(context);
        let (position, pass) = (frame.position(), context.cumulative_pass_nr());
        let known = self.kept.get(&position).map(|kept| kept.part);
        if let Some(part) = wanted.filter(|_| known < wanted) {
            self.request(frame, part, pass);
        }
        let kept = self.kept.get_mut(&position)?;
        kept.used_in = pass;
        kept.pictures.as_ref()
    }

    fn request(&mut self, frame: &FrameRef, part: Part, pass: u64) {
        let position = frame.position();
        let is_new = !self.kept.contains_key(&position);
        // Relaxed: no other memory depends on the flag.
        let is_ready = self.decoder.is_ready(self.yields_cores.load(Ordering::Relaxed));
        if !is_ready || is_new && !self.make_room(pass) {
            return;
        }
        let (alone, asked) = (self.alone.clone(), frame.clone());
        let decode = move || alone.install(|| decode(&asked, part));
        if self.decoder.start("thumbnails", position, self.waker.clone(), decode).is_ok() {
            // The part at the request, so that a frame that fails is not decoded again in every pass.
            let new = StoredThumbnails { part, used_in: pass, pictures: None };
            self.kept.entry(position).or_insert(new).part = part;
        }
    }

    /// Stores the thumbnails of frames that training has decoded since the last call.
    pub fn take_trained(
        &mut self,
        context: &Context,
        opened: &Opened,
        trained: &TrainedThumbnails,
    ) {
        let pass = context.cumulative_pass_nr();
        let of_opened = trained.take().into_iter().filter(|frame| frame.serial == opened.serial);
        for TrainedThumbnail { position, pictures, .. } in of_opened {
            let Some(frame) = FrameRef::trained(opened, position) else { continue };
            let position = frame.position();
            let known = self.kept.get(&position);
            // Pictures that were decoded for the strip are finer.
            let is_whole = known
                .is_some_and(|kept| kept.part == Part::PhotoAndDepth && kept.pictures.is_some());
            if !is_whole && (known.is_some() || self.make_room(pass)) {
                let pictures = Some(pictures.loaded(context, position));
                let part = Part::PhotoAndDepth;
                self.kept.insert(position, StoredThumbnails { part, used_in: pass, pictures });
            }
        }
    }

    /// Makes room for another frame. If the store is full, drops the least recently used frame unless it is
    /// displayed. Returns true if there is room.
    fn make_room(&mut self, pass: u64) -> bool {
        if self.kept.len() < MAX_KEPT {
            return true;
        }
        let oldest = self.kept.iter().min_by_key(|(_, kept)| kept.used_in);
        // Frames used in the previous pass are still on screen.
        let oldest = oldest.filter(|(_, kept)| kept.used_in + 1 < pass);
        match oldest.map(|(&position, _)| position) {
            Some(position) => self.kept.remove(&position).is_some(),
            None => false,
        }
    }

    fn take_decoded(&mut self) -> Option<((usize, usize), Pictures<ColorImage>)> {
        let (position, decoded) = self.decoder.take()?;
        let pictures = decoded.unwrap_or_else(|panic| Pictures {
            photo: None,
            depth: None,
            problem: Some(panic.failure_notice("decoding the frame")),
        });
        Some((position, pictures))
    }

    fn take(&mut self, context: &Context) {
        let Some((position, pictures)) = self.take_decoded() else { return };
        // A frame that was dropped meanwhile is no longer on screen.
        if let Some(kept) = self.kept.get_mut(&position) {
            kept.pictures = Some(pictures.loaded(context, position));
        }
    }
}

impl Pictures<ColorImage> {
    fn loaded(self, context: &Context, position: (usize, usize)) -> Pictures<TextureHandle> {
        let load = |what: &str, image: ColorImage| {
            let name = format!("{what} {position:?}");
            context.load_texture(name, image, TextureOptions::LINEAR)
        };
        Pictures {
            photo: self.photo.map(|image| load("photograph", image)),
            depth: self.depth.map(|image| load("depth", image)),
            problem: self.problem,
        }
    }
}

fn decode(frame: &FrameRef, part: Part) -> Pictures<ColorImage> {
    let position = frame.position();
    let photo_alone = || {
        let color = frame.entry().load_color().map_err(|error| error.to_string());
        color.map(|color| (color, None))
    };
    // Together, because training also rejects an incomplete frame, for the same reason.
    let whole = || {
        let loaded = frame.dataset().load(position.0, position.1);
        loaded.map(|frame| (frame.color, frame.depth)).map_err(|error| error.to_string())
    };
    let (loaded, problem) = match part {
        Part::Photo => (photo_alone(), None),
        Part::PhotoAndDepth => match whole() {
            // Without depth the photograph still identifies the frame.
            Err(problem) => (photo_alone(), Some(problem)),
            loaded => (loaded, None),
        },
    };
    match loaded {
        Ok((color, depth)) => pictures_of(&color, depth.as_ref(), SAMPLES, problem),
        Err(error) => Pictures { photo: None, depth: None, problem: problem.or(Some(error)) },
    }
}

fn pictures_of(
    color: &Image<[u8; 4]>,
    depth: Option<&Depth>,
    samples: usize,
    problem: Option<String>,
) -> Pictures<ColorImage> {
    let size = [color.width, color.height];
    let photo = shrink(size, samples, |column, row| *color.at(column, row));
    Pictures { photo: Some(photo), depth: depth.map(depth_picture), problem }
}

/// Returns the size of a thumbnail, and the side length of the pixel blocks that are reduced to one pixel
/// each.
fn reduced(size: [usize; 2]) -> (usize, [usize; 2]) {
    let factor = size[0].max(size[1]).div_ceil(MAX_SIDE).max(1);
    (factor, size.map(|side| (side / factor).max(1)))
}

/// Reduces an image by averaging up to `samples` × `samples` pixels of every block. Transparent pixels become
/// black.
fn shrink(
    [width, height]: [usize; 2],
    samples: usize,
    pixel: impl Fn(usize, usize) -> [u8; 4],
) -> ColorImage {
    let (factor, size) = reduced([width, height]);
    let step = factor.div_ceil(samples);
    let sampled = |block: usize, side: usize| {
        (block * factor..((block + 1) * factor).min(side)).step_by(step)
    };
    let mut pixels = Vec::with_capacity(size[0] * size[1]);
    for row in 0..size[1] {
        for column in 0..size[0] {
            let mut sum = [0u32; 3];
            let mut n = 0;
            for y in sampled(row, height) {
                for x in sampled(column, width) {
                    let [r, g, b, a] = pixel(x, y).map(u32::from);
                    // Weighted by alpha, which makes transparent pixels black.
                    sum = [sum[0] + r * a / 255, sum[1] + g * a / 255, sum[2] + b * a / 255];
                    n += 1;
                }
            }
            let [r, g, b] = sum.map(|sum| (sum / n.max(1)) as u8);
            pixels.push(Color32::from_rgb(r, g, b));
        }
    }
    ColorImage::new(size, pixels)
}

/// Maps depth to colours. The colours cover the range of depths without the nearest and farthest 2 %.
fn depth_picture(depth: &Depth) -> ColorImage {
    // One pixel per block: a mean across an edge would be a surface that does not exist.
    let (width, height) = depth.size();
    let (factor, size) = reduced([width, height]);
    let middle = |i: usize, side: usize| (i * factor + factor / 2).min(side - 1);
    let places = (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| (column, row)));
    let values: Vec<Option<f64>> =
        places.map(|(x, y)| depth.value_at(middle(x, width), middle(y, height))).collect();
    let stride = values.len().div_ceil(RANGE_SAMPLES).max(1);
    let mut known: Vec<f64> = values.iter().flatten().copied().step_by(stride).collect();
    known.sort_by(f64::total_cmp);
    let [near, far] = [0.02, 0.98].map(|q| quantile(&known, q));
    // Positive: a wall seen head-on has a single depth.
    let span = (far - near).max(f64::MIN_POSITIVE);
    let color = |value: f64| to_color32(ramp(((value - near) / span) as f32));
    ColorImage::new(size, values.into_iter().map(|value| value.map_or(HOLE, color)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::depth::{DepthCodes, DepthKind};
    use crate::pipeline::session::demo_dataset;
    use std::time::{Duration, Instant};

    #[test]
    fn thumbnails_keep_shape_and_mean() {
        let stripes = |column: usize, _: usize| {
            let gray = if column.is_multiple_of(2) { 100 } else { 120 };
            [gray, gray, gray, 255]
        };
        let image = shrink([640, 480], SAMPLES, stripes);
        assert_eq!(image.size, [160, 120]);
        assert_eq!(image.pixels[0], Color32::from_gray(110));
        // Every other column.
        let coarse = shrink([640, 480], FEW_SAMPLES, stripes);
        assert_eq!((coarse.size, coarse.pixels[0]), ([160, 120], Color32::from_gray(100)));
        assert_eq!(shrink([1, 3], SAMPLES, |_, _| [9, 9, 9, 0]).pixels, [Color32::BLACK; 3]);
    }

    #[test]
    fn depth_runs_from_violet_to_yellow_and_holes_are_dark() {
        let mut lengths = Image::filled(400, 2, 0.0f32);
        for row in 0..2 {
            for column in 1..400 {
                lengths.data[row * 400 + column] = column as f32;
            }
        }
        let codes = DepthCodes::Lengths(lengths);
        let depth = Depth { codes, kind: DepthKind::Z, trusted: [0.0, 9e9], units_per_metre: 1.0 };
        let image = depth_picture(&depth);
        assert_eq!(image.size, [133, 1]);
        let (near, far) = (image.pixels[0], image.pixels[132]);
        assert!(near.b() > near.g() && far.r() > 200 && far.g() > 200 && far.b() < 80);
        let depth = Depth { codes: DepthCodes::Lengths(Image::filled(2, 2, 0.0)), ..depth };
        assert_eq!(depth_picture(&depth).pixels, [HOLE; 4]);
    }

    fn wait_for_decoded(thumbnails: &mut Thumbnails) -> Pictures<ColorImage> {
        let started = Instant::now();
        loop {
            if let Some((_, decoded)) = thumbnails.take_decoded() {
                return decoded;
            }
            assert!(started.elapsed() < Duration::from_secs(60), "nothing is decoded");
            std::thread::sleep(Duration::from_millis(1));
        }
    }

    #[test]
    fn a_frame_whose_decoding_panics_is_told_and_the_next_one_is_decoded() {
        let dataset = demo_dataset().unwrap();
        let frame = FrameRef::first(&dataset).unwrap();
        let mut thumbnails = Thumbnails::start(Arc::new(|| {})).unwrap();
        let waker = thumbnails.waker.clone();
        let panics = || -> Pictures<ColorImage> { panic!("injected into decoding") };
        thumbnails.decoder.start("test", frame.position(), waker, panics).unwrap();
        let problem = wait_for_decoded(&mut thumbnails).problem.unwrap();
        assert!(problem.contains("injected into decoding"), "{problem}");
        thumbnails.request(&frame, Part::Photo, 1);
        assert!(wait_for_decoded(&mut thumbnails).photo.is_some());
    }

    /// Simulates scrolling past every frame of a long recording.
    #[test]
    fn what_is_on_screen_stays_and_the_rest_is_bounded() {
        let dataset = demo_dataset().unwrap();
        let frame = FrameRef::first(&dataset).unwrap();
        let mut thumbnails = Thumbnails::start(Arc::new(|| {})).unwrap();
        let kept =
            |used_in| StoredThumbnails { part: Part::PhotoAndDepth, used_in, pictures: None };
        thumbnails.kept = (0..MAX_KEPT).map(|i| ((7, i), kept(10 + i as u64))).collect();
        thumbnails.request(&frame, Part::PhotoAndDepth, 10);
        assert!(!thumbnails.kept.contains_key(&frame.position()), "all of them are on screen");
        thumbnails.request(&frame, Part::PhotoAndDepth, 12);
        assert!(thumbnails.kept.contains_key(&frame.position()));
        assert!(!thumbnails.kept.contains_key(&(7, 0)), "the least recently used one");
        assert_eq!(thumbnails.kept.len(), MAX_KEPT);
        let decoded = wait_for_decoded(&mut thumbnails);
        assert!(decoded.photo.is_some() && decoded.depth.is_some() && decoded.problem.is_none());
    }

    #[test]
    fn frames_of_training_wait_for_the_window_and_the_oldest_are_dropped() {
        let dataset = demo_dataset().unwrap();
        let frame = FrameRef::first(&dataset).unwrap().entry().load().unwrap();
        let trained = TrainedThumbnails::default();
        (0..MAX_WAITING + 6).for_each(|position| trained.add(3, position, &frame));
        let waiting = trained.take();
        let positions: Vec<usize> = waiting.iter().map(|frame| frame.position).collect();
        assert_eq!(positions, (6..MAX_WAITING + 6).collect::<Vec<_>>());
        assert!(trained.take().is_empty());
        let Pictures { photo, depth, .. } = &waiting[0].pictures;
        let sides = [photo, depth].map(|image| image.as_ref().unwrap().size);
        assert!(sides.iter().flatten().all(|&side| side > 0 && side <= MAX_SIDE), "{sides:?}");
    }
}
