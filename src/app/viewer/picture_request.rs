//! Request for the picture of the viewport: one render, or two and how they are compared.

use super::compared_model::ComparedModel;
use crate::math::camera::Camera;
use crate::math::image::RgbImage;
use crate::render::RenderOptions;
use crate::render::compare::{Area, Combination};
use std::sync::Arc;

/// Picture of the viewport.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureRequest {
    /// Camera of the whole viewport, in screen pixels.
    pub camera: Camera,
    /// Render options of the scene.
    pub options: RenderOptions,
    /// Picture that it is compared with, if any.
    pub second: Option<ComparedPicture>,
}

/// Second picture of a comparison.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedPicture {
    /// Source of the second picture.
    pub partner: Partner,
    /// Part of the viewport that it fills.
    pub area: Area,
    /// How the two pictures are combined.
    pub how: Combination,
}

/// Source of the second picture of a comparison.
#[derive(Clone, Debug)]
pub enum Partner {
    /// The same splats with other options.
    Splats(RenderOptions),
    /// Another model.
    Model(Arc<ComparedModel>, RenderOptions),
    /// The photograph taken by this camera.
    Photo(Arc<RgbImage>),
}

impl PartialEq for Partner {
    /// Compares photographs and models by address, never by content.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Splats(a), Self::Splats(b)) => a == b,
            (Self::Model(a, drawn), Self::Model(b, other)) => Arc::ptr_eq(a, b) && drawn == other,
            (Self::Photo(a), Self::Photo(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}
