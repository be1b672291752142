//! Where a frame was really taken from, before anything of it is learnt.

use super::SceneTrainer;
use crate::math::camera::Camera;
use crate::observation::surface::{Observation, SurfacePoint};
use crate::train::scene::align::{PoseAlignment, ROUNDS, looked_at};
use crate::train::scene::component_sums::SumScalar;
use crate::train::scene::known_planes::KnownPlanes;
use crate::train::scene::rigid_equations::Motion;
use crate::train::scene::seed_positions::SeedPositions;

impl<W: SumScalar> SceneTrainer<W> {
    /// The frame's points and camera as they stood, if the scene tells better than the recorded pose.
    pub(super) fn moved(&mut self, frame: &Observation) -> (Option<Vec<SurfacePoint>>, Camera) {
        match self.config.align.then(|| self.motion(frame)).flatten() {
            None => (None, frame.camera),
            Some(motion) => {
                let mut points = std::mem::take(&mut self.moved);
                let camera = motion.apply(frame, &mut points);
                (Some(points), camera)
            }
        }
    }

    /// The most probable motion of a frame; `None` where too little of the scene is known.
    pub(in crate::train::scene) fn motion(&mut self, frame: &Observation) -> Option<Motion> {
        let part = looked_at(frame);
        let mut owners = std::mem::take(&mut self.owners);
        let motion = self.motion_of(&part, &mut owners);
        self.owners = owners;
        motion
    }

    fn motion_of(&self, part: &Observation, owners: &mut Vec<u32>) -> Option<Motion> {
        let h = self.config.h;
        let ridge = self.config.splat_rule.gradient_ridge * h * h;
        let seed_positions = SeedPositions { grid: &self.grid, components: &self.components };
        let mut planes = KnownPlanes::new(&self.component_sums, seed_positions, h, ridge);
        let (mut motion, mut moved) = (Motion::NONE, Vec::new());
        for _ in 0..ROUNDS {
            motion.apply(part, &mut moved);
            // Anew in every round: points that move come to other components, and only those tell how
            // much farther they have to go.
            self.find_owners(&moved, owners);
            let gain = self.gain_of(&part.points, owners);
            let alignment = PoseAlignment { frame: part, owners, gain, h };
            let (next, has_settled) = alignment.improved(&motion, &mut planes)?;
            motion = next;
            if has_settled {
                break;
            }
        }
        Some(motion)
    }
}
