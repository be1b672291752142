//! Devices that compare photographs with the rendered picture: the CPU and optionally a GPU.
//!
//! After a device fails, the CPU compares that photograph and all that follow.

use crate::math::camera::Camera;
use crate::math::image::Image;
use crate::math::measured_pixel::MeasuredPixel;
use crate::model::inspection::DeviceError;
use crate::model::splat::appearance::SplatView;
use crate::render::cpu::photometric::{
    PhotometricComparer, PhotometricSums, PhotometricWalk, PixelRule, RowSubset, ViewBuffers,
};
use crate::train::device_trial::{
    ComparerMs, ComparerUse, DeviceChoice, DevicePolicy, DeviceTrial,
};
use crate::train::timing::Stopwatch;

/// Camera of a photograph and parameters of the comparison with the rendered scene.
pub struct TrainingView {
    /// Camera that took the photograph.
    pub camera: Camera,
    /// Near plane: distance from the camera, world units, below which splats are ignored.
    pub near: f64,
    /// Rows of the photograph that are compared.
    pub rows: RowSubset,
    /// The photograph is an outlier if its mean square residual exceeds the usual one by more than this
    /// factor.
    pub outlier_factor: f64,
    /// Number of pixels of the photograph per pixel of the depth image, at least 1.
    pub per_depth_pixel: f64,
    /// Number of frames before that of the photograph.
    pub frame: u64,
}

#[derive(Default)]
pub struct Comparers {
    view: ViewBuffers,
    processor: PhotometricWalk,
    device: Option<Device>,
    /// Number of photographs trained on by each device, and summed times in milliseconds.
    counts: ComparerUse,
    /// Value of `counts` at the last [`Self::begin_settling`]; `None` after [`Self::end_settling`].
    before_settling: Option<ComparerUse>,
    /// Latest comparison. It is added to `counts` after its photometric step.
    latest: LatestComparison,
}

/// Device and times of a comparison, without the time of the step that follows.
#[derive(Default)]
struct LatestComparison {
    is_by_device: bool,
    ms: ComparerMs,
}

struct Device {
    comparer: Box<dyn PhotometricComparer>,
    trial: DeviceTrial,
}

impl Comparers {
    pub fn add(&mut self, comparer: Box<dyn PhotometricComparer>, policy: DevicePolicy) {
        self.counts = ComparerUse { device: Some(comparer.name()), ..ComparerUse::default() };
        self.before_settling = None;
        self.device = Some(Device { comparer, trial: DeviceTrial::new(policy) });
    }

    /// Returns the number of photographs compared by each device, and mean times per photograph in
    /// milliseconds.
    pub fn used(&self) -> ComparerUse {
        let frames = (self.counts.device_frames + self.counts.processor_frames).max(1) as f64;
        let ComparerMs { prepare, compare, step } = self.counts.ms;
        let [prepare, compare, step] = [prepare, compare, step].map(|ms| ms / frames);
        ComparerUse { ms: ComparerMs { prepare, compare, step }, ..self.counts.clone() }
    }

    /// Adds the latest comparison to the counts, after a step that took `step_ms` milliseconds.
    pub fn count_step(&mut self, step_ms: f64) {
        let LatestComparison { is_by_device, ms } = std::mem::take(&mut self.latest);
        let Self { counts, .. } = self;
        let n = if is_by_device { &mut counts.device_frames } else { &mut counts.processor_frames };
        *n += 1;
        counts.ms.prepare += ms.prepare;
        counts.ms.compare += ms.compare;
        counts.ms.step += step_ms;
    }

    /// Saves the counts before temporary steps on buffered photographs for drawing. The steps are
    /// discarded when training resumes.
    pub fn begin_settling(&mut self) {
        self.end_settling();
        self.before_settling = Some(self.counts.clone());
    }

    /// Restores the counts saved by [`Self::begin_settling`], if there are any.
    pub fn end_settling(&mut self) {
        if let Some(before) = self.before_settling.take() {
            // Except those of the device, which may have failed meanwhile.
            let (trial, given_up) = (self.counts.trial, self.counts.given_up.take());
            self.counts = ComparerUse { trial, given_up, ..before };
        }
    }

    /// Compares a photograph with the rendered splats on the chosen device; see
    /// [`PhotometricComparer::compare`].
    pub fn compare(
        &mut self,
        splats: SplatView<'_>,
        training_view: &TrainingView,
        photograph: &Image<MeasuredPixel>,
        rule: PixelRule,
    ) -> PhotometricSums<'_> {
        let TrainingView { camera, near, rows, .. } = *training_view;
        // Dropped one call late, since the result of `compare` still borrows the device.
        if self.counts.given_up.is_some() {
            self.device = None;
        }
        let Self { view, processor, device, counts, latest, .. } = self;
        let mut clock = Stopwatch::start();
        let view = view.prepare(splats, &camera, near, photograph.height);
        let prepare = clock.lap_ms();
        let turn = device
            .as_mut()
            .map_or(DeviceChoice::Processor, |device| device.trial.choose(view.n_drawn()));
        let by_device = match device {
            Some(Device { comparer, trial }) if turn == DeviceChoice::Both => {
                // The device first, so that the CPU's result is the one returned.
                let answer = comparer.compare(&view, photograph, rule, rows);
                let (is_there, ms) = (note(answer, counts).is_some(), clock.lap_ms());
                let compared = processor.compare(&view, photograph, rule, rows);
                let processor_ms = clock.lap_ms();
                let ms_of_both = ComparerMs { prepare, compare: ms + processor_ms, step: 0.0 };
                *latest = LatestComparison { is_by_device: false, ms: ms_of_both };
                if is_there {
                    trial.record_times(processor_ms, ms);
                    counts.trial = trial.medians;
                }
                return compared;
            }
            Some(Device { comparer, .. }) if turn == DeviceChoice::Device => {
                note(comparer.compare(&view, photograph, rule, rows), counts)
            }
            _ => None,
        };
        let is_by_device = by_device.is_some();
        let compared =
            by_device.unwrap_or_else(|| processor.compare(&view, photograph, rule, rows));
        let ms = ComparerMs { prepare, compare: clock.lap_ms(), step: 0.0 };
        *latest = LatestComparison { is_by_device, ms };
        compared
    }
}

/// Returns the result of a device; `None` if the device failed. A failure is recorded and logged once,
/// since the device is then not used again.
fn note<'a>(
    answer: Result<PhotometricSums<'a>, DeviceError>,
    counts: &mut ComparerUse,
) -> Option<PhotometricSums<'a>> {
    answer
        .inspect_err(|error| {
            tracing::warn!("comparing a photograph: {error}");
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

    const RULE: PixelRule = PixelRule { full_coverage: 1.0, tau: 0.5, coverage: 1.0, depth: 0.5 };

    /// Device that compares on the CPU and fails after `left` photographs.
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
            photograph: &Image<MeasuredPixel>,
            rule: PixelRule,
            rows: RowSubset,
        ) -> Result<PhotometricSums<'a>, DeviceError> {
            let error = DeviceError { device: self.name(), reason: "gone".to_owned() };
            self.left = self.left.checked_sub(1).ok_or(error)?;
            Ok(self.walk.compare(view, photograph, rule, rows))
        }
    }

    fn squared_error(comparers: &mut Comparers) -> f64 {
        let intrinsics = Intrinsics::from_horizontal_fov(24, 20, 0.8);
        let camera = Camera { intrinsics, pose: Pose::IDENTITY };
        let photograph = Image::filled(24, 20, MeasuredPixel::without_depth([0.25, 0.5, 0.5, 1.0]));
        let mean = [0.0, 0.0, 2.0];
        let splat = Splat { mean, opacity: 0.9, scale: [0.3; 3], ..Splat::default() };
        let splats = [splat];
        let Some(view) = SplatView::new(&splats, &[]) else { return f64::NAN };
        let learnt = TrainingView {
            camera,
            near: 0.2,
            rows: RowSubset::ALL,
            outlier_factor: 6.0,
            per_depth_pixel: 1.0,
            frame: 0,
        };
        let squared_error = comparers.compare(view, &learnt, &photograph, RULE).squared_error;
        comparers.count_step(1.0);
        squared_error
    }

    /// Returns the numbers of photographs compared by the device and by the CPU.
    fn frames(comparers: &Comparers) -> [u64; 2] {
        let ComparerUse { device_frames, processor_frames, .. } = comparers.used();
        [device_frames, processor_frames]
    }

    #[test]
    fn the_very_photograph_that_a_device_fails_at_is_compared() {
        let mut comparers = Comparers::default();
        let expected = squared_error(&mut comparers);
        assert!(expected > 0.0);
        let failing = Failing { walk: PhotometricWalk::default(), left: 2 };
        comparers.add(Box::new(failing), DevicePolicy::Device);
        for counted in [[1, 0], [2, 0], [2, 1], [2, 2]] {
            assert_eq!(squared_error(&mut comparers), expected);
            assert_eq!(frames(&comparers), counted);
            assert_eq!(comparers.used().given_up.is_some(), counted[1] > 0);
        }
        assert!(comparers.device.is_none(), "a device that failed is not used again");
    }

    #[test]
    fn what_is_learnt_to_be_drawn_at_rest_counts_until_training_goes_on() {
        let mut comparers = Comparers::default();
        let failing = Failing { walk: PhotometricWalk::default(), left: 2 };
        comparers.add(Box::new(failing), DevicePolicy::Device);
        squared_error(&mut comparers);
        for _ in 0..2 {
            comparers.begin_settling();
            squared_error(&mut comparers);
            squared_error(&mut comparers);
        }
        assert_eq!(frames(&comparers), [1, 2]);
        comparers.end_settling();
        assert_eq!(frames(&comparers), [1, 0]);
        assert_eq!(comparers.used().ms.step, 1.0, "a mean");
        assert!(comparers.used().given_up.is_some(), "which happened at rest");
        comparers.end_settling();
        squared_error(&mut comparers);
        assert_eq!(frames(&comparers), [1, 1]);
    }
}
