//! Random scenes around the origin, and cameras that view them.

use glam::{DQuat, DVec3};
use std::sync::Arc;
use vbgs_studio::math::camera::{Camera, Intrinsics};
use vbgs_studio::math::pose::Pose;
use vbgs_studio::math::rng::{Purpose, Rng};
use vbgs_studio::math::sym3::Sym3;
use vbgs_studio::model::splat::appearance::{Appearance, Finishing, SplatSet};
use vbgs_studio::model::splat::observed_cone::ObservedCone;
use vbgs_studio::model::splat::splats::Splat;
use vbgs_studio::model::splat::texture::{
    ABSENT, Lattice, PATCH, TEXELS, Texel, Texture, Textures,
};
use vbgs_studio::render::{Antialias, ExactOptions, Lens, RenderMethod, RenderOptions, Response};

/// A random scene around the origin: centres uniform in a cube with side `2·radius`, standard deviations
/// log-uniform.
#[derive(Clone, Copy, Debug)]
pub struct Scene {
    pub name: &'static str,
    pub n_splats: usize,
    pub scale: (f64, f64),
    pub opacity: (f64, f64),
    pub radius: f64,
}

/// Scenes that exercise a renderer: opaque dots, translucent layers, needles and more.
pub const SCENES: [Scene; 6] = [
    Scene {
        name: "small",
        n_splats: 1500,
        scale: (0.01, 0.05),
        opacity: (0.95, 0.95),
        radius: 1.0,
    },
    Scene {
        name: "translucent",
        n_splats: 400,
        scale: (0.05, 0.3),
        opacity: (0.01, 0.6),
        radius: 1.0,
    },
    Scene { name: "needles", n_splats: 600, scale: (1e-4, 0.5), opacity: (0.2, 0.95), radius: 1.0 },
    Scene {
        name: "around the camera",
        n_splats: 800,
        scale: (0.02, 0.2),
        opacity: (0.3, 0.9),
        radius: 4.0,
    },
    Scene { name: "over one", n_splats: 500, scale: (0.02, 0.1), opacity: (0.9, 3.0), radius: 1.0 },
    // Rows of tiles have more splats than one batch of the rasteriser.
    Scene {
        name: "crowd",
        n_splats: 7000,
        scale: (0.1, 0.4),
        opacity: (0.004, 0.006),
        radius: 0.5,
    },
];

/// Scenes for splats with an appearance (`rendering.md`, Native appearance), with opacities up to 3.
pub const NATIVE_SCENES: [Scene; 3] = [
    Scene { name: "dots", n_splats: 1200, scale: (0.01, 0.05), opacity: (0.0, 3.0), radius: 1.0 },
    Scene { name: "clouds", n_splats: 200, scale: (0.05, 0.3), opacity: (0.0, 3.0), radius: 1.0 },
    Scene {
        name: "all around",
        n_splats: 500,
        scale: (0.02, 0.2),
        opacity: (0.0, 3.0),
        radius: 4.0,
    },
];

impl Scene {
    pub fn splats(&self, seed: u64) -> Vec<Splat> {
        let mut rng = Rng::new(seed, Purpose::Synthetic, 0);
        let (lo, hi) = (self.scale.0.ln(), self.scale.1.ln());
        (0..self.n_splats)
            .map(|_| Splat {
                mean: [0; 3].map(|_| rng.range(-self.radius, self.radius) as f32),
                opacity: rng.range(self.opacity.0, self.opacity.1) as f32,
                color: [0; 3].map(|_| rng.uniform() as f32),
                scale: [0; 3].map(|_| rng.range(lo, hi).exp() as f32),
                rotation: random_rotation(&mut rng),
            })
            .collect()
    }
}

/// Unit quaternion, uniform over all rotations.
pub fn random_rotation(rng: &mut Rng) -> [f32; 4] {
    let turn = [0; 4].map(|_| rng.normal());
    let length = turn.iter().map(|v| v * v).sum::<f64>().sqrt();
    turn.map(|v| (v / length) as f32)
}

/// Cone of observed directions around one direction, as wide as a moving camera observes.
pub fn cone([mean, across, _]: [[f32; 3]; 3]) -> ObservedCone {
    let [mean, across] = [mean, across].map(|row| DVec3::from_array(row.map(f64::from)));
    ObservedCone::new(mean, Sym3::outer(across).add_scaled(0.01, Sym3::diagonal(1.0)))
}

/// Random gradients and view dependence for splats. One standard deviation along the longest axis changes a
/// channel by about 0.25, so that the limit of 0.5 is reached too.
pub fn random_appearance(splats: &[Splat], seed: u64) -> Vec<Appearance> {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 1);
    let mut matrix = |size: f64| [0; 3].map(|_| [0; 3].map(|_| (size * rng.normal()) as f32));
    let largest = |splat: &Splat| splat.scale.iter().fold(0.0, |a: f32, b| a.max(*b));
    let appearance = splats.iter().map(|splat| Appearance {
        gradient: matrix(0.25 / f64::from(largest(splat))),
        directional: matrix(0.3),
        ..Appearance::default()
    });
    appearance.collect()
}

/// Splats with appearance and textures in the planes of most of them, some patches without texels.
pub fn textured_splats(seed: u64) -> SplatSet {
    let scene = Scene { n_splats: 40, scale: (0.05, 0.4), ..NATIVE_SCENES[1] };
    let splats = scene.splats(seed);
    let appearance = random_appearance(&splats, seed);
    let textures = random_textures(&splats, seed);
    let finishing = Finishing { textures: Some(Arc::new(textures)), ..Finishing::default() };
    SplatSet::new(splats, appearance).finished(finishing)
}

/// Random textures, slightly off the planes of their splats, for three of four splats.
pub fn random_textures(splats: &[Splat], seed: u64) -> Textures {
    let mut rng = Rng::new(seed, Purpose::Synthetic, 2);
    let textures = splats.iter().enumerate().map(|(i, splat)| {
        let largest = splat.scale.iter().fold(0.0, |a: f32, b| a.max(*b));
        let axes =
            splat.quaternion() * DQuat::from_axis_angle(DVec3::ONE.normalize(), 0.1 * rng.normal());
        let axis =
            |k: usize| (axes * DVec3::AXES[(splat.thinnest_axis() + k) % 3]).as_vec3().to_array();
        let lattice = Lattice {
            anchor: splat.mean.map(|v| v + 0.2 * largest * rng.normal() as f32),
            axes: [axis(1), axis(2)],
            half: 2.0 * largest,
            level: (i % 3) as u8,
        };
        let mut texel = || Texel::new([0; 3].map(|_| rng.uniform() as f32), rng.uniform() as f32);
        let mut patches = Vec::new();
        let index = (0..(lattice.side() / PATCH).pow(2)).map(|at| {
            if (at + i) % 5 == 4 {
                return ABSENT;
            }
            patches.push([0; TEXELS].map(|_| texel()));
            patches.len() as u16 - 1
        });
        let index = index.collect();
        (i % 4 != 3).then(|| Arc::new(Texture { lattice, index, patches }))
    });
    textures.collect()
}

/// Every renderer with every setting that changes its formulas.
pub const METHODS: [RenderMethod; 7] = [
    RenderMethod::Projected,
    exact(Response::Ray, Antialias::Footprint, Lens::Pinhole),
    exact(Response::Ray, Antialias::None, Lens::Pinhole),
    exact(Response::Line, Antialias::None, Lens::Pinhole),
    exact(Response::Line, Antialias::Reference, Lens::Pinhole),
    exact(Response::Ray, Antialias::Footprint, Lens::Fisheye),
    exact(Response::Ray, Antialias::None, Lens::Fisheye),
];

/// The exact renderer with its settings.
pub const fn exact(response: Response, antialias: Antialias, lens: Lens) -> RenderMethod {
    RenderMethod::Exact(ExactOptions { response, antialias, lens })
}

/// Camera whose image sides are not multiples of a tile and whose principal point is off centre.
pub fn camera() -> Camera {
    let mut intrinsics = Intrinsics::from_horizontal_fov(107, 77, 0.8);
    intrinsics.cx += 5.3;
    intrinsics.fy *= 1.1;
    let eye = DVec3::new(2.0, -2.5, 1.0);
    Camera { intrinsics, pose: Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap() }
}

/// [`camera`] with the method's lens. The fisheye sees 190° from a position among the splats.
pub fn camera_of(method: RenderMethod) -> Camera {
    let mut camera = camera();
    if method.lens() == Lens::Fisheye {
        let k = &mut camera.intrinsics;
        let shrink = f64::from(k.width) / 190f64.to_radians() / k.fx;
        (k.fx, k.fy) = (k.fx * shrink, k.fy * shrink);
        let eye = DVec3::new(0.75, -1.0, 0.5);
        camera.pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
    }
    camera
}

pub fn options(method: RenderMethod) -> RenderOptions {
    RenderOptions::evaluation(method, [0.1, 0.5, 0.9])
}
