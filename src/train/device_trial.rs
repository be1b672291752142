//! Which of two devices does a learner's work faster: measured, not guessed from a name.
//!
//! The first frames are worked on by both, and again whenever there is much more to do, since it is the
//! load that tips the balance.

use serde::{Deserialize, Serialize};

/// When a device beside the processor does the work.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum DevicePolicy {
    /// Always.
    Device,
    /// Where it is the faster of the two, by measurement.
    Fastest,
}

/// Why a device is given up whose bits are others.
pub(super) const DIFFERING: &str = "its arithmetic is not the processor's";

/// Milliseconds of the same work on each, the median of a few.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct DeviceMs {
    /// On the processor.
    pub processor: f64,
    /// On the device.
    pub device: f64,
}

/// One line for people on who did what to frames, such as "compared" and "photographs"; counts are the
/// device's and the processor's.
pub(super) fn who_did(
    [did, what]: [&str; 2],
    device: Option<&str>,
    counts: [u64; 2],
    trial: Option<DeviceMs>,
    given_up: Option<&str>,
) -> String {
    let Some(device) = device else { return format!("the processor {did} {what}") };
    let by = match counts {
        [0, _] => format!("the processor {did} {what}"),
        [_, 0] => format!("{device} {did} {what}"),
        [n, m] => format!("{device} {did} {n} {what}, the processor {m}"),
    };
    let measured = trial.map(|DeviceMs { processor, device: other }| {
        format!(" (measured: {other:.1} ms on {device}, {processor:.1} ms on the processor)")
    });
    let lost = given_up.map(|why| format!("; the device was given up: {why}"));
    by + &measured.unwrap_or_default() + &lost.unwrap_or_default()
}

/// Measurements of each before the choice.
const N_TRIALS: usize = 4;
/// Of these, the first ones: buffers still grow and clocks still rise.
const N_IGNORED: usize = 1;
/// Factor of the load past which the choice is made anew.
const MANY: usize = 2;
/// Load below which nothing is chosen: the first frames of a scene show few splats.
const FEW: usize = 1000;

/// Who works on a frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Turn {
    /// The processor.
    Processor,
    /// The device beside it.
    Device,
    /// Both, one after the other; the processor's word counts.
    Both,
}

/// The measurements, and what was chosen by them.
#[derive(Debug)]
pub(super) struct DeviceTrial {
    policy: DevicePolicy,
    /// What there was to do when the last choice was made: drawn splats, or points.
    load: usize,
    is_device_faster: bool,
    /// Milliseconds on the processor and on the device, while both are tried.
    tried: [Vec<f64>; 2],
    /// Medians of the last choice.
    pub medians: Option<DeviceMs>,
}

impl DeviceTrial {
    /// Nothing is measured yet.
    pub fn new(policy: DevicePolicy) -> Self {
        let tried = [(); 2].map(|()| Vec::with_capacity(N_TRIALS));
        Self { policy, load: 0, is_device_faster: false, tried, medians: None }
    }

    /// Who works on a frame of so many drawn splats or points.
    pub fn turn(&mut self, load: usize) -> Turn {
        if self.policy == DevicePolicy::Device {
            return Turn::Device;
        }
        let is_trying = !self.tried[0].is_empty();
        if is_trying || load >= FEW && load > MANY * self.load {
            self.load = self.load.max(load);
            return Turn::Both;
        }
        if self.is_device_faster { Turn::Device } else { Turn::Processor }
    }

    /// A frame that both worked on, milliseconds.
    pub fn measured(&mut self, processor: f64, device: f64) {
        let [on_processor, on_device] = &mut self.tried;
        on_processor.push(processor);
        on_device.push(device);
        if on_processor.len() < N_TRIALS {
            return;
        }
        let median = |tried: &mut Vec<f64>| {
            let kept = &mut tried[N_IGNORED..];
            // The median: another program's work in between must not decide.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faster_one_is_kept_until_there_is_much_more_to_do() {
        let mut trial = DeviceTrial::new(DevicePolicy::Fastest);
        assert_eq!(trial.turn(FEW - 1), Turn::Processor);
        let tried = |trial: &mut DeviceTrial, load, processor, device| {
            for _ in 0..N_TRIALS {
                assert_eq!(trial.turn(load), Turn::Both);
                trial.measured(processor, device);
            }
            trial.turn(load)
        };
        assert_eq!(tried(&mut trial, FEW, 3.0, 4.0), Turn::Processor);
        assert_eq!(trial.turn(2 * FEW), Turn::Processor);
        assert_eq!(tried(&mut trial, 2 * FEW + 1, 6.0, 5.0), Turn::Device);
        assert_eq!(trial.medians, Some(DeviceMs { processor: 6.0, device: 5.0 }));
        assert_eq!(trial.turn(1), Turn::Device);
    }

    #[test]
    fn one_slow_frame_decides_nothing() {
        let mut trial = DeviceTrial::new(DevicePolicy::Fastest);
        for device in [50.0, 1.0, 60.0, 1.0] {
            assert_eq!(trial.turn(FEW), Turn::Both);
            trial.measured(2.0, device);
        }
        assert_eq!(trial.turn(FEW), Turn::Device);
        assert_eq!(DeviceTrial::new(DevicePolicy::Device).turn(0), Turn::Device);
    }
}
