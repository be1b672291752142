//! Chooses between CPU and device by measured time.
//!
//! Both process the first frames. They do so again when the load has grown considerably, because the
//! faster one depends on the load.

use serde::{Deserialize, Serialize};

/// Policy for choosing between the CPU and a device.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DevicePolicy {
    /// Always uses the device.
    Device,
    /// Uses the faster of CPU and device, as measured.
    Fastest,
}

/// Reason for a fallback when the device's results differ from the CPU's.
pub(super) const DIFFERING: &str = "its arithmetic differs from the CPU's";

/// Median time of the same work on the CPU and on a device, milliseconds.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceMs {
    /// Time on the CPU.
    pub processor: f64,
    /// Time on the device.
    pub device: f64,
}

/// Formats a one-line summary. `did` and `what` are a verb and its object, such as "compared" and
/// "photographs". `counts` holds the number of objects processed by the device and by the CPU.
fn device_summary(
    [did, what]: [&str; 2],
    device: Option<&str>,
    counts: [u64; 2],
    trial: Option<DeviceMs>,
    given_up: Option<&str>,
) -> String {
    let Some(device) = device else { return format!("the CPU {did} {what}") };
    let by = match counts {
        [0, _] => format!("the CPU {did} {what}"),
        [_, 0] => format!("{device} {did} {what}"),
        [n, m] => format!("{device} {did} {n} {what}, the CPU {m}"),
    };
    let measured = trial.map(|DeviceMs { processor, device: other }| {
        format!(" (measured: {other:.1} ms on {device}, {processor:.1} ms on the CPU)")
    });
    let lost = given_up.map(|why| format!("; fell back to the CPU: {why}"));
    by + &measured.unwrap_or_default() + &lost.unwrap_or_default()
}

/// Number of frames that both CPU and device process in a trial, before the faster one is chosen.
const N_TRIALS: usize = 4;
// Leading measurements to ignore: buffers are still growing and clocks rising.
const N_IGNORED: usize = 1;
/// A new trial begins when the load exceeds the largest load of the previous trials by this factor.
const MANY: usize = 2;
// Load below which no trial runs: the first frames of a scene show few splats.
const FEW: usize = 1000;

/// Choice of where a frame is processed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum DeviceChoice {
    Processor,
    Device,
    /// Both: first the device, then the CPU, whose result is used.
    Both,
}

/// Timings of CPU and device, and the resulting choice.
#[derive(Debug)]
pub(super) struct DeviceTrial {
    policy: DevicePolicy,
    /// Largest load in a trial so far. The load is the number of drawn splats or of points.
    load: usize,
    is_device_faster: bool,
    /// True once CPU and device have processed a frame with equal results. Always true if their results
    /// may differ by rounding.
    is_verified: bool,
    /// Milliseconds on the CPU and on the device for each frame of the current trial.
    times_ms: [Vec<f64>; 2],
    /// Median times of the last trial.
    pub medians: Option<DeviceMs>,
}

impl DeviceTrial {
    /// Creates a trial of a device whose results may differ from the CPU's by rounding.
    pub fn new(policy: DevicePolicy) -> Self {
        Self { is_verified: true, ..Self::unverified(policy) }
    }

    /// Creates a trial of a device whose results must first be compared with the CPU's.
    pub fn unverified(policy: DevicePolicy) -> Self {
        let times_ms = [(); 2].map(|()| Vec::with_capacity(N_TRIALS));
        Self {
            policy,
            load: 0,
            is_device_faster: false,
            is_verified: false,
            times_ms,
            medians: None,
        }
    }

    /// Chooses where a frame of `load` splats or points is processed.
    pub fn choose(&mut self, load: usize) -> DeviceChoice {
        if self.policy == DevicePolicy::Device {
            return if self.is_verified { DeviceChoice::Device } else { DeviceChoice::Both };
        }
        let is_trying = !self.times_ms[0].is_empty();
        // A trial that has begun ends, whatever the load of its later frames.
        // The first load is 0, so that `FEW` alone begins the first trial.
        if is_trying || load >= FEW && load > MANY * self.load {
            // The largest load of a trial: its own later frames must not begin another.
            self.load = self.load.max(load);
            return DeviceChoice::Both;
        }
        if self.is_device_faster { DeviceChoice::Device } else { DeviceChoice::Processor }
    }

    /// Records the times, in milliseconds, that the CPU and the device took for the same frame. If
    /// their results must agree, they have already been compared.
    pub fn record_times(&mut self, processor: f64, device: f64) {
        self.is_verified = true;
        let [on_processor, on_device] = &mut self.times_ms;
        on_processor.push(processor);
        on_device.push(device);
        if on_processor.len() < N_TRIALS {
            return;
        }
        let median = |tried: &mut Vec<f64>| {
            let kept = &mut tried[N_IGNORED..];
            // The median tolerates interruptions by other programs.
            kept.sort_by(f64::total_cmp);
            let median = kept[kept.len() / 2];
            tried.clear();
            median
        };
        let (processor, device) = (median(on_processor), median(on_device));
        self.is_device_faster = device < processor;
        self.medians = Some(DeviceMs { processor, device });
    }
}

/// Devices used to compare photographs with renderings in this session. Each trained photograph counts
/// once. After [`Learner::settle`](crate::train::learner::Learner::settle), photographs still in the
/// shuffle buffer count as trained.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ComparerUse {
    /// Name of the device requested besides the CPU, if any.
    pub device: Option<String>,
    /// Number of trained photographs compared by the device.
    pub device_frames: u64,
    /// Number of trained photographs compared by the CPU.
    pub processor_frames: u64,
    /// Timings that decided between device and CPU, if measured.
    pub trial: Option<DeviceMs>,
    /// Reason for a fallback to the CPU, if any.
    pub given_up: Option<String>,
    /// Mean milliseconds per photograph.
    pub ms: ComparerMs,
}

/// Mean milliseconds per photograph, by stage.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ComparerMs {
    /// Time to project, sort and bin splats, on the CPU.
    pub prepare: f64,
    /// Time to compare pixels on the chosen device; during a trial, the sum for CPU and device.
    pub compare: f64,
    /// Time to compute and apply the optimisation step, on the CPU.
    pub step: f64,
}

impl ComparerUse {
    /// Returns a one-line summary of the devices that compared photographs.
    pub fn summary_line(&self) -> String {
        let counts = [self.device_frames, self.processor_frames];
        let Self { device, trial, given_up, .. } = self;
        let did = ["compared", "photographs"];
        device_summary(did, device.as_deref(), counts, *trial, given_up.as_deref())
    }
}

/// Devices used in this session to fit frames: for the passes of a mixture, or for the points of a
/// scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct PassUse {
    /// Name of the device requested besides the CPU, if any.
    pub device: Option<String>,
    /// Number of frames processed by the device.
    pub device_frames: u64,
    /// Number of frames processed by the CPU.
    pub processor_frames: u64,
    /// Share of tiles (for a scene, of points) that the device left to the CPU.
    pub open_share: f64,
    /// Timings of one fit that decided between device and CPU, if measured.
    pub trial: Option<DeviceMs>,
    /// Reason for a fallback to the CPU, if any.
    pub given_up: Option<String>,
}

impl PassUse {
    /// Records a fallback to the CPU and logs one warning.
    pub(super) fn record_fallback(&mut self, reason: String) {
        tracing::warn!("{}: {reason}", self.device.as_deref().unwrap_or_default());
        self.given_up = Some(reason);
    }

    /// Returns a one-line summary of the devices that fitted frames.
    pub fn summary_line(&self) -> String {
        let counts = [self.device_frames, self.processor_frames];
        let Self { device, trial, given_up, .. } = self;
        let did = ["fitted", "frames"];
        device_summary(did, device.as_deref(), counts, *trial, given_up.as_deref())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faster_one_is_kept_until_there_is_much_more_to_do() {
        let mut trial = DeviceTrial::new(DevicePolicy::Fastest);
        assert_eq!(trial.choose(FEW - 1), DeviceChoice::Processor);
        let tried = |trial: &mut DeviceTrial, load, processor, device| {
            for _ in 0..N_TRIALS {
                assert_eq!(trial.choose(load), DeviceChoice::Both);
                trial.record_times(processor, device);
            }
            trial.choose(load)
        };
        assert_eq!(tried(&mut trial, FEW, 3.0, 4.0), DeviceChoice::Processor);
        assert_eq!(trial.choose(2 * FEW), DeviceChoice::Processor);
        assert_eq!(tried(&mut trial, 2 * FEW + 1, 6.0, 5.0), DeviceChoice::Device);
        assert_eq!(trial.medians, Some(DeviceMs { processor: 6.0, device: 5.0 }));
        assert_eq!(trial.choose(1), DeviceChoice::Device);
    }

    #[test]
    fn one_slow_frame_decides_nothing() {
        let mut trial = DeviceTrial::new(DevicePolicy::Fastest);
        for device in [50.0, 1.0, 60.0, 1.0] {
            assert_eq!(trial.choose(FEW), DeviceChoice::Both);
            trial.record_times(2.0, device);
        }
        assert_eq!(trial.choose(FEW), DeviceChoice::Device);
        assert_eq!(DeviceTrial::new(DevicePolicy::Device).choose(0), DeviceChoice::Device);
    }
}

#[cfg(test)]
mod summary_tests {
    use super::*;

    #[test]
    fn the_line_says_what_was_used() {
        let mut found = ComparerUse { processor_frames: 3, ..ComparerUse::default() };
        assert_eq!(found.summary_line(), "the CPU compared photographs");
        found.device = Some("Card".into());
        found.device_frames = 5;
        found.trial = Some(DeviceMs { processor: 12.0, device: 1.5 });
        assert_eq!(
            found.summary_line(),
            "Card compared 5 photographs, the CPU 3 (measured: 1.5 ms on Card, 12.0 ms on the CPU)"
        );
        found = ComparerUse { trial: None, given_up: Some("lost".into()), ..found };
        assert!(found.summary_line().ends_with("the CPU 3; fell back to the CPU: lost"));
        let fitted = PassUse { processor_frames: 3, ..PassUse::default() };
        assert_eq!(fitted.summary_line(), "the CPU fitted frames");
    }
}
