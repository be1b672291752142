//! OpenEXR: half or single floats, in a channel of any name.

use crate::dataset::error::FrameProblem;
use crate::dataset::lengths::{StoredDepth, check_size};
use crate::math::image::Image;
use ::exr::meta::MetaData;
use ::exr::prelude::{ReadChannels, ReadLayers, read as open};
use std::io::Cursor;

/// Names of depth channels, in order of preference; otherwise the first channel is used.
const NAMES: [&str; 5] = ["Z", "Y", "R", "V", "depth"];

pub(super) fn read(bytes: &[u8]) -> Result<StoredDepth, FrameProblem> {
    let wrong = |found: String| FrameProblem::DepthFile { expected: "a whole EXR image", found };
    let damaged = |e: ::exr::error::Error| wrong(e.to_string());
    let meta = MetaData::read_from_buffered(Cursor::new(bytes), false).map_err(damaged)?;
    for header in &meta.headers {
        let size = header.layer_size;
        check_size(bytes, [size.width(), size.height()], 2 * header.channels.list.len())?;
    }
    let image = open()
        .no_deep_data()
        .largest_resolution_level()
        .all_channels()
        .first_valid_layer()
        .all_attributes()
        .non_parallel()
        .from_buffered(Cursor::new(bytes))
        .map_err(damaged)?;
    let channels = &image.layer_data.channel_data.list;
    let named = |name: &&str| channels.iter().find(|c| c.name.eq_case_insensitive(name));
    let channel = NAMES.iter().find_map(named).or_else(|| channels.first());
    let channel = channel.ok_or_else(|| wrong("no channel".to_owned()))?;
    let size = image.layer_data.size;
    let values = channel.sample_data.values_as_f32().collect();
    Ok(StoredDepth::Floats(Image::from_vec(size.width(), size.height(), values)))
}
