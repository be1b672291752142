//! Camera animation: keyframes and interpolation between them.

use super::orbit::Orbit;
use super::pose::Pose;
use glam::{DQuat, DVec4};
use std::f64::consts::TAU;

// A cubic between 12 keyframes deviates from the circle by a thousandth of its radius.
const TURNTABLE_KEYFRAMES: u32 = 12;

/// Camera pose and field of view at one point in time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Keyframe {
    /// Time from the start of the path, seconds.
    pub time: f64,
    /// Camera pose, world units.
    pub pose: Pose,
    /// Vertical field of view, radians.
    pub fov_y: f64,
}

/// A smooth camera path through keyframes.
///
/// Position, rotation and field of view are piecewise cubic with a continuous first derivative. Tangents
/// are those of Catmull and Rom (1974), generalised to unevenly spaced times. Rotations are interpolated
/// as normalised quaternions with matching signs. Neighbouring keyframes should be less than half a turn
/// apart.
///
/// ```
/// use glam::DVec3;
/// use vbgs_studio::math::{camera_path::{CameraPath, Keyframe}, pose::Pose};
///
/// let at = |time, x| {
///     let pose = Pose::look_at(DVec3::new(x, -2.0, 0.0), DVec3::ZERO, DVec3::Z);
///     pose.map(|pose| Keyframe { time, pose, fov_y: 0.8 })
/// };
/// let keyframes: Option<Vec<Keyframe>> = [at(0.0, -1.0), at(2.0, 1.0)].into_iter().collect();
/// let path = keyframes.and_then(|keyframes| CameraPath::new(keyframes, false));
/// let middle = path.map(|path| path.at(1.0).pose.centre().x);
/// assert!(middle.is_some_and(|x| x.abs() < 1e-9));
/// ```
#[derive(Clone, Debug, PartialEq)]
pub struct CameraPath {
    keyframes: Vec<Keyframe>,
    is_loop: bool,
}

/// Interpolated values of a keyframe. The first vector holds position and field of view, the second the
/// rotation as a quaternion.
type Values = [DVec4; 2];

impl CameraPath {
    /// Builds a path through keyframes. Returns `None` for fewer than two keyframes or if their times do
    /// not increase.
    ///
    /// In a loop, the last keyframe must equal the first in pose and field of view. The path passes both
    /// with the same velocity.
    pub fn new(keyframes: Vec<Keyframe>, is_loop: bool) -> Option<Self> {
        let rises = keyframes.windows(2).all(|pair| pair[0].time < pair[1].time);
        (keyframes.len() > 1 && rises).then_some(Self { keyframes, is_loop })
    }

    /// Builds a loop that circles an orbit's target once in `seconds`, which must be positive. `fov_y`
    /// is in radians.
    pub fn turntable(orbit: &Orbit, fov_y: f64, seconds: f64) -> Self {
        let keyframe = |i: u32| {
            let share = f64::from(i) / f64::from(TURNTABLE_KEYFRAMES);
            // The loop closes bit for bit.
            let turn = if i == TURNTABLE_KEYFRAMES { 0.0 } else { share * TAU };
            let pose = Orbit { azimuth: orbit.azimuth + turn, ..*orbit }.pose();
            Keyframe { time: share * seconds, pose, fov_y }
        };
        Self { keyframes: (0..=TURNTABLE_KEYFRAMES).map(keyframe).collect(), is_loop: true }
    }

    /// Returns the keyframes in order of time.
    pub fn keyframes(&self) -> &[Keyframe] {
        &self.keyframes
    }

    /// True if the path ends where it starts.
    pub fn is_loop(&self) -> bool {
        self.is_loop
    }

    /// Returns the seconds from the first keyframe to the last.
    pub fn duration(&self) -> f64 {
        self.keyframes[self.keyframes.len() - 1].time - self.keyframes[0].time
    }

    /// Returns the interpolated camera `seconds` after the first keyframe. Times beyond either end of
    /// the path are clamped.
    pub fn at(&self, seconds: f64) -> Keyframe {
        let time = self.keyframes[0].time + seconds.clamp(0.0, self.duration());
        let next = self.keyframes.partition_point(|keyframe| keyframe.time <= time);
        // No segment begins at the last keyframe.
        let i = next.clamp(1, self.keyframes.len() - 1) - 1;
        let [a, b] = [self.keyframes[i], self.keyframes[i + 1]];
        // Keyframes are exact: as quaternions, their rotations would change in the last bits.
        if time == a.time {
            return a;
        }
        if time == b.time {
            return b;
        }
        let span = b.time - a.time;
        let (from, to) = (values(&a, None), values(&b, Some(&a)));
        let [out, into] = [self.derivative_at(i, from[1]), self.derivative_at(i + 1, to[1])];
        let t = (time - a.time) / span;
        let (t2, t3) = (t * t, t * t * t);
        // Cubic Hermite polynomials; slopes count per span.
        let [place, turn] = sum([
            times(from, 2.0 * t3 - 3.0 * t2 + 1.0),
            times(times(out, span), t3 - 2.0 * t2 + t),
            times(to, 3.0 * t2 - 2.0 * t3),
            times(times(into, span), t3 - t2),
        ]);
        let turn = DQuat::from_vec4(turn.normalize());
        let pose = Pose::IDENTITY.attached_camera(place.truncate(), turn);
        Keyframe { time, pose, fov_y: place.w }
    }

    /// Returns the derivative per second of the interpolated values at keyframe `i`. `turn` is the
    /// keyframe's quaternion with the sign used in the interpolated segment.
    fn derivative_at(&self, i: usize, turn: DVec4) -> Values {
        let last = self.keyframes.len() - 1;
        let here = self.keyframes[i];
        // In a loop, the successor of the last keyframe is the second one.
        let before = match (i, self.is_loop) {
            (0, false) => None,
            (0, true) => Some((self.keyframes[last - 1], self.duration())),
            _ => Some((self.keyframes[i - 1], 0.0)),
        };
        let after = match (i == last, self.is_loop) {
            (true, false) => None,
            (true, true) => Some((self.keyframes[1], self.duration())),
            _ => Some((self.keyframes[i + 1], 0.0)),
        };
        let [place, _] = values(&here, None);
        let slope = |(other, period): (Keyframe, f64), sign: f64| {
            let span = sign * (other.time - here.time) + period;
            let there = with_matching_sign(values(&other, None), turn);
            times([there[0] - place, there[1] - turn], sign / span)
        };
        match (before, after) {
            // Slope of the parabola through three keyframes: the shorter interval weighs more.
            (Some(before), Some(after)) => {
                let [a, b] =
                    [here.time - before.0.time + before.1, after.0.time - here.time + after.1];
                let [incoming, outgoing] = [slope(before, -1.0), slope(after, 1.0)];
                sum([times(incoming, b / (a + b)), times(outgoing, a / (a + b))])
            }
            (None, Some(only)) => slope(only, 1.0),
            (Some(only), None) => slope(only, -1.0),
            (None, None) => Values::default(),
        }
    }
}

/// Returns the values of a keyframe. If the keyframe `beside` is given, the quaternion's sign is chosen
/// to match that of `beside`.
fn values(keyframe: &Keyframe, beside: Option<&Keyframe>) -> Values {
    let turn =
        |keyframe: &Keyframe| DVec4::from(DQuat::from_mat3(&keyframe.pose.rotation()).normalize());
    let own = [keyframe.pose.centre().extend(keyframe.fov_y), turn(keyframe)];
    beside.map_or(own, |beside| with_matching_sign(own, turn(beside)))
}

/// Negates the quaternion if that brings it nearer to `beside`. Both signs represent the same rotation.
fn with_matching_sign([place, turn]: Values, beside: DVec4) -> Values {
    [place, if turn.dot(beside) < 0.0 { -turn } else { turn }]
}

fn times(values: Values, factor: f64) -> Values {
    values.map(|value| factor * value)
}

fn sum<const N: usize>(terms: [Values; N]) -> Values {
    terms.into_iter().reduce(|a, b| [a[0] + b[0], a[1] + b[1]]).unwrap_or_default()
}

#[cfg(test)]
mod tests {
    use super::*;
    use glam::DVec3;

    fn looking(time: f64, angle: f64, distance: f64) -> Keyframe {
        let eye = distance * DVec3::new(angle.cos(), angle.sin(), 0.3);
        let pose = Pose::look_at(eye, DVec3::ZERO, DVec3::Z).unwrap();
        Keyframe { time, pose, fov_y: 0.5 + 0.1 * time }
    }

    fn way() -> Vec<Keyframe> {
        vec![
            looking(1.0, 0.0, 2.0),
            looking(1.5, 0.7, 2.5),
            looking(4.0, 2.5, 1.5),
            looking(5.0, 3.0, 2.0),
        ]
    }

    #[test]
    fn keyframes_are_passed_exactly_and_ends_are_held() {
        let path = CameraPath::new(way(), false).unwrap();
        assert_eq!(path.duration(), 4.0);
        for keyframe in way() {
            assert_eq!(path.at(keyframe.time - 1.0), keyframe);
        }
        assert_eq!(path.at(-3.0), way()[0]);
        assert_eq!(path.at(1e9), way()[3]);
    }

    #[test]
    fn places_and_turns_change_smoothly_everywhere() {
        let mut round = way();
        round.push(Keyframe { time: 7.0, ..round[0] });
        for (keyframes, is_loop) in [(way(), false), (round, true)] {
            let path = CameraPath::new(keyframes, is_loop).unwrap();
            let step = 1e-4;
            let speed = |t: f64| {
                let [a, b] = [path.at(t), path.at(t + step)];
                let forward = (b.pose.forward() - a.pose.forward()) / step;
                ((b.pose.centre() - a.pose.centre()) / step, forward)
            };
            let n = 4_000;
            let length = path.duration() - step;
            let mut last = speed(0.0);
            for i in 1..=n {
                let now = speed(length * f64::from(i) / f64::from(n));
                assert!((now.0 - last.0).length() < 0.03, "{i}: {last:?} {now:?}");
                assert!((now.1 - last.1).length() < 0.03, "{i}: {last:?} {now:?}");
                last = now;
            }
            let first = speed(0.0);
            let closes = (last.0 - first.0).length() < 0.03;
            assert_eq!(closes, is_loop, "{last:?} {first:?}");
        }
    }

    #[test]
    fn either_sign_of_a_quaternion_is_the_same_turn() {
        // A full turn in steps of 60 degrees, during which the quaternions change sign.
        let keyframes =
            (0..=6).map(|i| looking(f64::from(i), f64::from(i) * std::f64::consts::FRAC_PI_3, 2.0));
        let path = CameraPath::new(keyframes.collect(), true).unwrap();
        for i in 0..600 {
            let camera = path.at(f64::from(i) / 100.0).pose;
            let inward = -camera.centre().normalize();
            assert!(camera.forward().dot(inward) > 0.999, "{i}: {camera:?}");
        }
    }

    #[test]
    fn a_turntable_stays_on_its_circle() {
        let (target, up) = (DVec3::new(1.0, 2.0, 3.0), DVec3::Z);
        let orbit = Orbit { target, up, azimuth: 0.4, elevation: 0.5, distance: 3.0 };
        let path = CameraPath::turntable(&orbit, 0.8, 10.0);
        assert_eq!((path.at(0.0).pose, path.at(10.0).pose), (orbit.pose(), orbit.pose()));
        let quarter = path.keyframes()[3];
        let turned = Orbit { azimuth: 0.4 + std::f64::consts::FRAC_PI_2, ..orbit }.pose();
        assert_eq!((quarter.time, quarter.fov_y), (2.5, 0.8));
        assert!((quarter.pose.centre() - turned.centre()).length() < 1e-12);
        for i in 0..500 {
            let camera = path.at(f64::from(i) / 50.0).pose;
            let way = target - camera.centre();
            assert!((way.length() / 3.0 - 1.0).abs() < 2e-3, "{i}: {}", way.length());
            assert!(camera.forward().dot(way.normalize()) > 1.0 - 1e-5, "{i}");
        }
    }

    #[test]
    fn others_are_no_paths() {
        let [a, b] = [looking(0.0, 0.0, 1.0), looking(1.0, 0.1, 1.0)];
        for wrong in [vec![], vec![a], vec![b, a], vec![a, a]] {
            assert_eq!(CameraPath::new(wrong, false), None);
        }
    }
}
