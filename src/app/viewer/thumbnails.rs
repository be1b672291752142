//! Thumbnails of photographs and depth, decoded lazily on a separate thread and stored as textures.
//!
//! Their number is bounded, so that memory does not grow with the dataset: the least recently used is
//! dropped, but never one on screen. During training the thread rests for a multiple of the decoding
//! time and does not wake the window, which takes finished thumbnails when it repaints anyway.

use super::frame_refs::FrameRef;
use crate::app::panic_report::PanicReport;
use crate::app::view_thread::one_thread;
use crate::app::worker::Waker;
use crate::dataset::depth::Depth;
use crate::eval::report::quantile;
use crate::render::finish::ramp;
use eframe::egui::{Color32, ColorImage, Context, TextureHandle, TextureOptions};
use std::collections::HashMap;
use std::panic::{AssertUnwindSafe, catch_unwind};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};
use std::time::{Duration, Instant};

/// Longest side of a thumbnail, pixels.
const MAX_SIDE: usize = 192;
const MAX_WAITING: usize = 4;
/// Maximum number of stored frames, about 220 kB each: enough for the cameras in the viewport, a strip
/// across a wide screen and a table of views.
const MAX_KEPT: usize = 256;
/// Rest after a frame during training, as a multiple of the decoding time: on two cores training slows
/// down by half of 1/`REST`.
const REST: u32 = 15;
/// Interval at which a resting thread checks whether training still runs.
const POLL_INTERVAL: Duration = Duration::from_millis(50);
/// Colour of depth pixels without a measurement.
const HOLE: Color32 = Color32::from_gray(18);

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Part {
    Photo,
    PhotoAndDepth,
}

/// Pictures of a frame, or the reason why some are missing.
struct Pictures<T> {
    photo: Option<T>,
    depth: Option<T>,
    problem: Option<String>,
}

/// Position of a frame in its dataset, and its pictures.
type Decoded = ((usize, usize), Pictures<ColorImage>);

struct StoredThumbnails {
    /// Largest part requested so far.
    part: Part,
    /// Pass of the window that used it last.
    used_in: u64,
    /// `None` until decoded.
    pictures: Option<Pictures<TextureHandle>>,
}

#[derive(Clone, Copy, Default)]
pub struct FramePictures<'a> {
    pub photo: Option<&'a TextureHandle>,
    /// Depth over its own range, from violet (near) to yellow (far).
    pub depth: Option<&'a TextureHandle>,
    pub problem: Option<&'a str>,
}

pub struct Thumbnails {
    requests: SyncSender<(FrameRef, Part)>,
    decoded: Receiver<Decoded>,
    kept: HashMap<(usize, usize), StoredThumbnails>,
    /// Number of frames queued or being decoded.
    n_waiting: usize,
    yields_cores: Arc<AtomicBool>,
}

impl Thumbnails {
    /// Starts the thread, which ends when this value is dropped.
    pub fn start(waker: Waker) -> std::io::Result<Self> {
        let (requests, inbox) = sync_channel(MAX_WAITING);
        let (answers, decoded) = sync_channel(MAX_WAITING);
        let yields_cores = Arc::new(AtomicBool::new(false));
        let flag = yields_cores.clone();
        // One thread, so that parallel decoders do not use all cores.
        let alone = one_thread()?;
        let work = move || {
            serve(&inbox, &answers, &flag, &waker, |frame, part| {
                alone.install(|| decode(frame, part))
            })
        };
        std::thread::Builder::new().name("thumbnails".into()).spawn(work)?;
        Ok(Self { requests, decoded, kept: HashMap::new(), n_waiting: 0, yields_cores })
    }

    pub fn set_yields_cores(&self, stands_back: bool) {
        // Relaxed: no other memory depends on the flag.
        self.yields_cores.store(stands_back, Ordering::Relaxed);
    }

    /// Returns the thumbnail of a photograph if it is decoded; else requests it if `may_decode`.
    pub fn get(
        &mut self,
        context: &Context,
        frame: &FrameRef,
        may_decode: bool,
    ) -> Option<&TextureHandle> {
        self.look_up(context, frame, may_decode.then_some(Part::Photo)).photo
    }

    pub fn pictures(&mut self, context: &Context, frame: &FrameRef) -> FramePictures<'_> {
        self.look_up(context, frame, Some(Part::PhotoAndDepth))
    }

    fn look_up(
        &mut self,
        context: &Context,
        frame: &FrameRef,
        wanted: Option<Part>,
    ) -> FramePictures<'_> {
        self.take(context);
        let (position, pass) = (frame.position(), context.cumulative_pass_nr());
        let known = self.kept.get(&position).map(|kept| kept.part);
        if let Some(part) = wanted
            && known.is_none_or(|known| known == Part::Photo && part == Part::PhotoAndDepth)
        {
            self.request(frame, part, pass);
        }
        let Some(kept) = self.kept.get_mut(&position) else { return FramePictures::default() };
        kept.used_in = pass;
        kept.pictures.as_ref().map_or_else(FramePictures::default, |pictures| FramePictures {
            photo: pictures.photo.as_ref(),
            depth: pictures.depth.as_ref(),
            problem: pictures.problem.as_deref(),
        })
    }

    fn request(&mut self, frame: &FrameRef, part: Part, pass: u64) {
        let position = frame.position();
        let is_new = !self.kept.contains_key(&position);
        if self.n_waiting == MAX_WAITING || is_new && !self.make_room(pass) {
            return;
        }
        match self.requests.try_send((frame.clone(), part)) {
            Ok(()) => {
                self.n_waiting += 1;
                let new = StoredThumbnails { part, used_in: pass, pictures: None };
                self.kept.entry(position).or_insert(new).part = part;
            }
            Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
        }
    }

    /// Drops the least recently used frame if the store is full; true if there is room.
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

    fn take(&mut self, context: &Context) {
        while let Ok((position, Pictures { photo, depth, problem })) = self.decoded.try_recv() {
            self.n_waiting = self.n_waiting.saturating_sub(1);
            let load = |what: &str, image: ColorImage| {
                let name = format!("{what} {position:?}");
                context.load_texture(name, image, TextureOptions::LINEAR)
            };
            // A frame that was dropped meanwhile is no longer on screen.
            if let Some(kept) = self.kept.get_mut(&position) {
                kept.pictures = Some(Pictures {
                    photo: photo.map(|image| load("photograph", image)),
                    depth: depth.map(|image| load("depth", image)),
                    problem,
                });
            }
        }
    }
}

fn serve(
    inbox: &Receiver<(FrameRef, Part)>,
    answers: &SyncSender<Decoded>,
    stands_back: &AtomicBool,
    waker: &Waker,
    decode: impl Fn(&FrameRef, Part) -> Pictures<ColorImage>,
) {
    while let Ok((frame, part)) = inbox.recv() {
        let started = Instant::now();
        // Caught, because without this thread no further thumbnail would ever appear.
        let decoded = catch_unwind(AssertUnwindSafe(|| decode(&frame, part)));
        let decoded = decoded.unwrap_or_else(|panic| Pictures {
            photo: None,
            depth: None,
            problem: Some(PanicReport::of(&*panic).failure_notice("decoding the frame")),
        });
        let rest_until = Instant::now() + started.elapsed() * REST;
        if answers.send((frame.position(), decoded)).is_err() {
            return;
        }
        if !stands_back.load(Ordering::Relaxed) {
            waker();
        }
        while stands_back.load(Ordering::Relaxed) && Instant::now() < rest_until {
            std::thread::sleep(POLL_INTERVAL);
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
        Ok((color, depth)) => {
            let size = [color.width, color.height];
            let photo = shrink(size, |column, row| *color.at(column, row));
            let depth = depth.as_ref().map(depth_picture);
            Pictures { photo: Some(photo), depth, problem }
        }
        Err(error) => Pictures { photo: None, depth: None, problem: problem.or(Some(error)) },
    }
}

/// Returns the block size and the resulting image size of a reduction.
fn reduced(size: [usize; 2]) -> (usize, [usize; 2]) {
    let factor = size[0].max(size[1]).div_ceil(MAX_SIDE).max(1);
    (factor, size.map(|side| (side / factor).max(1)))
}

/// Averages blocks of pixels; transparent pixels count as black.
fn shrink([width, height]: [usize; 2], pixel: impl Fn(usize, usize) -> [u8; 4]) -> ColorImage {
    let (factor, size) = reduced([width, height]);
    let mut pixels = Vec::with_capacity(size[0] * size[1]);
    for row in 0..size[1] {
        for column in 0..size[0] {
            let mut sum = [0u32; 3];
            let mut n = 0;
            for y in (row * factor..(row + 1) * factor).take_while(|&y| y < height) {
                for x in (column * factor..(column + 1) * factor).take_while(|&x| x < width) {
                    let [r, g, b, a] = pixel(x, y).map(u32::from);
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

/// Maps depth to colours, over its range without the nearest and farthest 2 %. Samples one pixel per
/// block: a mean across an edge would be a surface that does not exist.
fn depth_picture(depth: &Depth) -> ColorImage {
    let (width, height) = depth.size();
    let (factor, size) = reduced([width, height]);
    let middle = |i: usize, side: usize| (i * factor + factor / 2).min(side - 1);
    let places = (0..size[1]).flat_map(|row| (0..size[0]).map(move |column| (column, row)));
    let values: Vec<Option<f64>> =
        places.map(|(x, y)| depth.value_at(middle(x, width), middle(y, height))).collect();
    let mut known: Vec<f64> = values.iter().flatten().copied().collect();
    known.sort_by(f64::total_cmp);
    let [near, far] = [0.02, 0.98].map(|q| quantile(&known, q));
    let span = (far - near).max(f64::MIN_POSITIVE);
    let color = |value: f64| {
        let [r, g, b] = ramp(((value - near) / span) as f32).map(|c| (255.0 * c).round() as u8);
        Color32::from_rgb(r, g, b)
    };
    ColorImage::new(size, values.into_iter().map(|value| value.map_or(HOLE, color)).collect())
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::dataset::depth::{DepthCodes, DepthKind};
    use crate::math::image::Image;
    use crate::pipeline::start;

    #[test]
    fn thumbnails_keep_shape_and_mean() {
        let stripes = |column: usize, _: usize| {
            let gray = if column.is_multiple_of(2) { 100 } else { 120 };
            [gray, gray, gray, 255]
        };
        let image = shrink([640, 480], stripes);
        assert_eq!(image.size, [160, 120]);
        assert_eq!(image.pixels[0], Color32::from_gray(110));
        assert_eq!(shrink([1, 3], |_, _| [9, 9, 9, 0]).pixels, [Color32::BLACK; 3]);
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

    #[test]
    fn a_frame_whose_decoding_panics_is_told_and_the_next_one_is_decoded() {
        let dataset = start::dataset().unwrap();
        let frame = FrameRef::first(&dataset).unwrap();
        let (requests, inbox) = sync_channel(2);
        let (answers, decoded) = sync_channel(2);
        requests.send((frame.clone(), Part::PhotoAndDepth)).unwrap();
        requests.send((frame, Part::Photo)).unwrap();
        drop(requests);
        let waker: Waker = Arc::new(|| {});
        serve(&inbox, &answers, &AtomicBool::new(false), &waker, |frame, part| {
            assert!(part == Part::Photo, "injected into decoding");
            decode(frame, part)
        });
        let problem = decoded.recv().unwrap().1.problem.unwrap();
        assert!(problem.contains("injected into decoding"), "{problem}");
        assert!(decoded.recv().unwrap().1.photo.is_some());
    }

    /// Simulates scrolling past every frame of a long recording.
    #[test]
    fn what_is_on_screen_stays_and_the_rest_is_bounded() {
        let dataset = start::dataset().unwrap();
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
        let (_, decoded) = thumbnails.decoded.recv_timeout(Duration::from_secs(60)).unwrap();
        assert!(decoded.photo.is_some() && decoded.depth.is_some() && decoded.problem.is_none());
    }
}
