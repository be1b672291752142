//! What photographs are compared on: the processor, and a device beside it if one was handed in.
//!
//! A device that fails is given up: the processor compares that very photograph and all that follow.

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::model::splat::appearance::SplatView;
use crate::render::cpu::photometric::{
    Compared, ComparerError, PhotometricComparer, PhotometricWalk, PixelRule, RowChoice,
    ViewBuffers,
};
use crate::train::comparer_use::{ComparerMs, ComparerUse};
use crate::train::device_trial::{DevicePolicy, DeviceTrial, Turn};
use crate::train::timing::Stopwatch;

/// How a photograph is looked at.
pub struct LearntView {
    /// The camera that took it.
    pub camera: Camera,
    /// What is nearer than so many world units is not compared.
    pub near: f64,
    /// The rows that are learnt.
    pub rows: RowChoice,
    /// Times the usual mean square from which on it contradicts the scene.
    pub contradicts_from: f64,
}

/// Comparers and their memory.
#[derive(Default)]
pub struct Comparers {
    view: ViewBuffers,
    processor: PhotometricWalk,
    device: Option<Device>,
    /// Frames so far; milliseconds are sums.
    counts: ComparerUse,
}

struct Device {
    comparer: Box<dyn PhotometricComparer>,
    trial: DeviceTrial,
}

impl Comparers {
    /// Compares on a device too from now on.
    pub fn add(&mut self, comparer: Box<dyn PhotometricComparer>, policy: DevicePolicy) {
        self.counts = ComparerUse { device: Some(comparer.name()), ..ComparerUse::default() };
        self.device = Some(Device { comparer, trial: DeviceTrial::new(policy) });
    }

    /// What was used so far.
    pub fn used(&self) -> ComparerUse {
        let frames = (self.counts.device_frames + self.counts.processor_frames).max(1) as f64;
        let ComparerMs { prepare, compare, step } = self.counts.ms;
        let [prepare, compare, step] = [prepare, compare, step].map(|ms| ms / frames);
        ComparerUse { ms: ComparerMs { prepare, compare, step }, ..self.counts.clone() }
    }

    /// Books the time of a step.
    pub fn stepped(&mut self, ms: f64) {
        self.counts.ms.step += ms;
    }

    /// See [`PhotometricComparer::compare`].
    pub fn compare(
        &mut self,
        splats: SplatView<'_>,
        learnt: &LearntView,
        photograph: &Image<[f32; 4]>,
        rule: PixelRule,
    ) -> Compared<'_> {
        let LearntView { camera, near, rows, .. } = *learnt;
        self.view.near = near;
        if self.counts.given_up.is_some() {
            self.device = None;
        }
        let Self { view, processor, device, counts } = self;
        let mut clock = Stopwatch::start();
        let view = view.prepare(splats, &camera, photograph.height);
        counts.ms.prepare += clock.lap_ms();
        let turn =
            device.as_mut().map_or(Turn::Processor, |device| device.trial.turn(view.n_drawn()));
        let by_device = match device {
            Some(Device { comparer, trial }) if turn == Turn::Both => {
                // The device first: the processor's answer is the one that is kept.
                let answer = comparer.compare(&view, photograph, rule, rows);
                let (is_there, ms) = (note(answer, counts).is_some(), clock.lap_ms());
                let compared = processor.walk(&view, photograph, rule, rows);
                let processor_ms = clock.lap_ms();
                counts.ms.compare += ms + processor_ms;
                counts.processor_frames += 1;
                if is_there {
                    trial.measured(processor_ms, ms);
                    counts.trial = trial.medians;
                }
                return compared;
            }
            Some(Device { comparer, .. }) if turn == Turn::Device => {
                note(comparer.compare(&view, photograph, rule, rows), counts)
            }
            _ => None,
        };
        let (count, compared) = match by_device {
            Some(compared) => (&mut counts.device_frames, compared),
            None => (&mut counts.processor_frames, processor.walk(&view, photograph, rule, rows)),
        };
        *count += 1;
        counts.ms.compare += clock.lap_ms();
        compared
    }
}

/// What a device found; a failure is said once, since the device is given up then.
fn note<'a>(
    answer: Result<Compared<'a>, ComparerError>,
    counts: &mut ComparerUse,
) -> Option<Compared<'a>> {
    answer
        .inspect_err(|error| {
            tracing::warn!("{error}");
            counts.given_up = Some(error.reason.clone());
        })
        .ok()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::math::camera::Intrinsics;
    use crate::math::pose::Pose;
    use crate::model::splat::splats::Splat;
    use crate::render::cpu::photometric::PreparedView;

    const RULE: PixelRule = PixelRule { full_coverage: 1.0, tau: 0.5, coverage: 1.0 };

    /// The processor under another name, which fails from a photograph on.
    struct Failing {
        walk: PhotometricWalk,
        left: usize,
    }

    impl PhotometricComparer for Failing {
        fn name(&self) -> String {
            "card".to_owned()
        }

        fn compare<'a>(
            &'a mut self,
            view: &PreparedView<'a>,
            photograph: &Image<[f32; 4]>,
            rule: PixelRule,
            rows: RowChoice,
        ) -> Result<Compared<'a>, ComparerError> {
            let error = ComparerError { device: self.name(), reason: "gone".to_owned() };
            self.left = self.left.checked_sub(1).ok_or(error)?;
            self.walk.compare(view, photograph, rule, rows)
        }
    }

    fn squared_error(comparers: &mut Comparers) -> f64 {
        let intrinsics = Intrinsics::from_horizontal_fov(24, 20, 0.8);
        let camera = Camera { intrinsics, pose: Pose::IDENTITY };
        let photograph = Image::filled(24, 20, [0.25, 0.5, 0.5, 1.0]);
        let mean = [0.0, 0.0, 2.0];
        let splat = Splat { mean, opacity: 0.9, scale: [0.3; 3], ..Splat::default() };
        let splats = [splat];
        let Some(view) = SplatView::new(&splats, &[]) else { return f64::NAN };
        let learnt = LearntView { camera, near: 0.2, rows: RowChoice::ALL, contradicts_from: 6.0 };
        comparers.compare(view, &learnt, &photograph, RULE).squared_error
    }

    #[test]
    fn the_very_photograph_that_a_device_fails_at_is_compared() {
        let mut comparers = Comparers::default();
        let expected = squared_error(&mut comparers);
        assert!(expected > 0.0);
        let failing = Failing { walk: PhotometricWalk::default(), left: 2 };
        comparers.add(Box::new(failing), DevicePolicy::Device);
        for (device_frames, processor_frames) in [(1, 0), (2, 0), (2, 1), (2, 2)] {
            assert_eq!(squared_error(&mut comparers), expected);
            let used = comparers.used();
            assert_eq!(
                (used.device_frames, used.processor_frames),
                (device_frames, processor_frames)
            );
            assert_eq!(used.given_up.is_some(), processor_frames > 0);
        }
        assert!(comparers.device.is_none(), "a device that failed is not asked again");
    }
}
