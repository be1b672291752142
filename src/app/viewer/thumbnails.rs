//! Small copies of photographs, decoded lazily on a thread of their own and kept as textures.

use super::frame_refs::FrameRef;
use crate::app::worker::Waker;
use eframe::egui::{Color32, ColorImage, Context, TextureHandle, TextureOptions};
use std::collections::HashMap;
use std::collections::hash_map::Entry;
use std::sync::mpsc::{Receiver, SyncSender, TrySendError, sync_channel};

/// Longest side, pixels.
const MAX_SIDE: usize = 192;
/// Photographs that wait to be decoded.
const MAX_WAITING: usize = 4;

/// A photograph that was decoded: split and index, and its small copy where that succeeded.
type Decoded = ((usize, usize), Option<ColorImage>);

/// Thumbnails of one dataset.
pub struct Thumbnails {
    requests: SyncSender<FrameRef>,
    decoded: Receiver<Decoded>,
    /// `None` while it is decoded, and for good where it cannot be.
    textures: HashMap<(usize, usize), Option<TextureHandle>>,
    /// Waiting or being decoded.
    n_waiting: usize,
}

impl Thumbnails {
    /// Starts the thread, which ends with this value.
    pub fn start(waker: Waker) -> std::io::Result<Self> {
        let (requests, inbox) = sync_channel::<FrameRef>(MAX_WAITING);
        let (answers, decoded) = sync_channel(MAX_WAITING);
        std::thread::Builder::new().name("thumbnails".into()).spawn(move || {
            while let Ok(frame) = inbox.recv() {
                // Skipped frames are told of elsewhere.
                let image = frame.entry().load_color().ok().map(|color| {
                    shrink([color.width, color.height], |column, row| *color.at(column, row))
                });
                if answers.send((frame.position(), image)).is_err() {
                    return;
                }
                waker();
            }
        })?;
        Ok(Self { requests, decoded, textures: HashMap::new(), n_waiting: 0 })
    }

    /// A frame's thumbnail if it is known; asks for it if it is not and `may_decode`.
    pub fn get(
        &mut self,
        context: &Context,
        frame: &FrameRef,
        may_decode: bool,
    ) -> Option<&TextureHandle> {
        self.take(context);
        let position = frame.position();
        if let Entry::Vacant(vacant) = self.textures.entry(position)
            && may_decode
            && self.n_waiting < MAX_WAITING
        {
            match self.requests.try_send(frame.clone()) {
                Ok(()) => {
                    vacant.insert(None);
                    self.n_waiting += 1;
                }
                Err(TrySendError::Full(_) | TrySendError::Disconnected(_)) => {}
            }
        }
        self.textures.get(&position)?.as_ref()
    }

    fn take(&mut self, context: &Context) {
        while let Ok((position, image)) = self.decoded.try_recv() {
            self.n_waiting = self.n_waiting.saturating_sub(1);
            let name = format!("thumbnail {position:?}");
            let texture =
                image.map(|image| context.load_texture(name, image, TextureOptions::LINEAR));
            self.textures.insert(position, texture);
        }
    }
}

/// Means over blocks of pixels; what is transparent becomes dark.
fn shrink([width, height]: [usize; 2], pixel: impl Fn(usize, usize) -> [u8; 4]) -> ColorImage {
    let factor = width.max(height).div_ceil(MAX_SIDE).max(1);
    let size = [width, height].map(|side| (side / factor).max(1));
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

#[cfg(test)]
mod tests {
    use super::*;

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
}
