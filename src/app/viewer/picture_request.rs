//! What the viewport is asked to show: one picture, or two and how they are compared.

use super::compared_model::ComparedModel;
use crate::math::camera::Camera;
use crate::math::image::RgbImage;
use crate::render::RenderOptions;
use crate::render::compare::{Area, Combination};
use std::sync::Arc;

/// A picture of the viewport.
#[derive(Clone, Debug, PartialEq)]
pub struct PictureRequest {
    /// Camera for the whole viewport, in pixels of the screen.
    pub camera: Camera,
    /// How the scene is drawn.
    pub options: RenderOptions,
    /// What it is compared with.
    pub second: Option<ComparedPicture>,
}

/// What a picture is compared with.
#[derive(Clone, Debug, PartialEq)]
pub struct ComparedPicture {
    /// The other picture.
    pub partner: Partner,
    /// The part of the viewport that it fills.
    pub area: Area,
    /// What is shown of the two.
    pub how: Combination,
}

/// The other picture.
#[derive(Clone, Debug)]
pub enum Partner {
    /// The same splats, drawn otherwise.
    Splats(RenderOptions),
    /// Another model, drawn by itself.
    Model(Arc<ComparedModel>, RenderOptions),
    /// The photograph that was taken from here.
    Photo(Arc<RgbImage>),
}

impl PartialEq for Partner {
    /// Photographs and models are the same if they are one in memory: what they hold is never
    /// compared.
    fn eq(&self, other: &Self) -> bool {
        match (self, other) {
            (Self::Splats(a), Self::Splats(b)) => a == b,
            (Self::Model(a, drawn), Self::Model(b, other)) => Arc::ptr_eq(a, b) && drawn == other,
            (Self::Photo(a), Self::Photo(b)) => Arc::ptr_eq(a, b),
            _ => false,
        }
    }
}
