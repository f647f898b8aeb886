//! What scenes are described with, but for geometry.
use std::f32::consts::FRAC_PI_4;

use crate::{CameraType, Filter, MaterialType, Transform, Wrap, IDENTITY};

macro_rules! ids {
    ($($(#[$doc:meta])* $name:ident)*) => {$(
        $(#[$doc])*
        #[derive(Debug, Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
        pub struct $name(
            /// The number that the ABI and hits use.
            pub u32,
        );
    )*};
}

ids! {
    /// A geometry of a scene; geometries count from 0.
    GeometryId
    /// An instance of a scene; instances count from 0.
    InstanceId
    /// A light of a scene; lights count from 0.
    LightId
    /// A camera of a scene; cameras count from 0.
    CameraId
    /// A texture of a scene; textures count from 1.
    TextureId
    /// A material of a scene; materials count from 1. The default, 0, is a white Lambertian surface.
    #[derive(Default)]
    MaterialId
}

/// The values of a [`Texture`]. Row 0 is the top row and lies at v = 0, as in glTF.
#[derive(Debug, Clone, Copy)]
#[non_exhaustive]
pub enum Texels<'a> {
    /// Colours are decoded from sRGB before filtering; alpha is linear.
    Srgb8(&'a [[u8; 4]]),
    /// Values / 255.
    Linear8(&'a [[u8; 4]]),
    /// Values as they are; finite.
    Float(&'a [[f32; 4]]),
}

/// An image that surfaces and the environment can use. It is copied.
#[derive(Debug, Clone, Copy)]
#[must_use]
pub struct Texture<'a> {
    /// `width * height` values, row by row.
    pub texels: Texels<'a>,
    /// Texels a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Beyond the left and right edges.
    pub wrap_u: Wrap,
    /// Beyond the top and bottom edges.
    pub wrap_v: Wrap,
    /// Between texel centres.
    pub filter: Filter,
}

impl<'a> Texture<'a> {
    /// A texture that repeats and is filtered linearly.
    pub fn new(width: u32, height: u32, texels: Texels<'a>) -> Self {
        Texture { texels, width, height, wrap_u: Wrap::Repeat, wrap_v: Wrap::Repeat, filter: Filter::Linear }
    }
}

/// How a surface scatters and emits light. The default is a white Lambertian surface.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct Material {
    /// The kind of scattering.
    pub kind: MaterialType,
    /// Linear, in [0, 1]; zero is black.
    pub base_color: [f32; 3],
    /// Metal: in (0, 1].
    pub roughness: f32,
    /// Glass: index of refraction.
    pub ior: f32,
    /// Multiplies the texture's alpha; used with `alpha_cutoff` or `blends` alone.
    pub alpha: f32,
    /// Parts whose alpha is below it are holes; 0: none.
    pub alpha_cutoff: f32,
    /// Alpha is opacity: of light, 1 - alpha passes straight on. Wants `alpha_cutoff` 0.
    pub blends: bool,
    /// Radiance, W/(m² sr) up to the lights' scale; zero: not a lamp.
    pub emission: [f32; 3],
    /// Multiplies `base_color`.
    pub base_color_texture: Option<TextureId>,
    /// Emits from both sides, not from the counter-clockwise side alone.
    pub two_sided_emission: bool,
    /// Multiplies `emission`, at the texture coordinates of `base_color_texture`; its alpha does not count.
    pub emission_texture: Option<TextureId>,
    /// Glass: the share of light that is left after `attenuation_distance` within it, linear, in [0, 1].
    pub attenuation_color: [f32; 3],
    /// Glass: metres of the world; 0: it does not absorb.
    pub attenuation_distance: f32,
}

impl Default for Material {
    fn default() -> Self {
        Material {
            kind: MaterialType::Lambert,
            base_color: [1.0; 3],
            roughness: 1.0,
            ior: 1.5,
            alpha: 1.0,
            alpha_cutoff: 0.0,
            blends: false,
            emission: [0.0; 3],
            base_color_texture: None,
            two_sided_emission: false,
            emission_texture: None,
            attenuation_color: [1.0; 3],
            attenuation_distance: 0.0,
        }
    }
}

/// A light without extent. Lamps with extent are materials that emit.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum Light {
    /// Shines from a point in all directions.
    Point {
        /// W/sr.
        intensity: [f32; 3],
        /// World space.
        position: [f32; 3],
    },
    /// Shines from a point into a cone.
    Spot {
        /// W/sr on the axis.
        intensity: [f32; 3],
        /// World space.
        position: [f32; 3],
        /// Where the light shines; need not be of unit length.
        direction: [f32; 3],
        /// Full intensity within; 0 is the axis alone.
        inner_cone_angle_rad: f32,
        /// None beyond; in (inner, pi/2]; falloff as glTF defines it.
        outer_cone_angle_rad: f32,
    },
    /// Shines in parallel from infinity.
    Distant {
        /// On a surface that faces the light, W/m².
        irradiance: [f32; 3],
        /// Where the light shines; need not be of unit length.
        direction: [f32; 3],
    },
}

/// A camera. The default stands at the origin and looks along -Z, with Y up.
#[derive(Debug, Clone, Copy, PartialEq)]
#[must_use]
pub struct Camera {
    /// The projection.
    pub kind: CameraType,
    /// Camera to world; scale is ignored.
    pub transform: Transform,
    /// Full vertical angle.
    pub yfov_rad: f32,
    /// This version of the library: must be 0 (pinhole).
    pub lens_radius: f32,
    /// This version of the library: must be 0.
    pub focus_distance: f32,
    /// This version of the library: must be 0.
    pub shutter_open: f32,
    /// This version of the library: must be 0.
    pub shutter_close: f32,
    /// The image width that the scene's author meant; 0: not said.
    pub width: u32,
    /// The image height that the scene's author meant; 0: not said.
    pub height: u32,
}

impl Default for Camera {
    fn default() -> Self {
        Camera {
            kind: CameraType::Perspective,
            transform: IDENTITY,
            yfov_rad: FRAC_PI_4,
            lens_radius: 0.0,
            focus_distance: 0.0,
            shutter_open: 0.0,
            shutter_close: 0.0,
            width: 0,
            height: 0,
        }
    }
}
