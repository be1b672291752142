//! Which of two devices compares photographs faster: measured, not guessed from a name.
//!
//! The first photographs are compared on both, and again whenever a view shows many more splats, since
//! it is the load that tips the balance.

use crate::train::comparer_use::{ComparerPolicy, ComparerTrial};

/// Measurements of each before the choice.
const N_TRIALS: usize = 4;
/// Of these, the first ones: buffers still grow and clocks still rise.
const N_IGNORED: usize = 1;
/// Factor of drawn splats past which the choice is made anew.
const MANY: usize = 2;
/// Drawn splats below which nothing is chosen: the first frames of a scene show few.
const FEW: usize = 1000;

/// Who compares a photograph.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turn {
    /// The processor.
    Processor,
    /// The device beside it.
    Device,
    /// Both, one after the other; the processor's word counts.
    Both,
}

/// The measurements, and what was chosen by them.
#[derive(Debug)]
pub struct Trial {
    policy: ComparerPolicy,
    /// Drawn splats that the last choice was made for.
    load: usize,
    is_device_faster: bool,
    /// Milliseconds on the processor and on the device, while both are tried.
    tried: [Vec<f64>; 2],
    /// Medians of the last choice.
    pub medians: Option<ComparerTrial>,
}

impl Trial {
    /// Nothing is measured yet.
    pub fn new(policy: ComparerPolicy) -> Self {
        let tried = [(); 2].map(|()| Vec::with_capacity(N_TRIALS));
        Self { policy, load: 0, is_device_faster: false, tried, medians: None }
    }

    /// Who compares a photograph of so many drawn splats.
    pub fn turn(&mut self, n_drawn: usize) -> Turn {
        if self.policy == ComparerPolicy::Device {
            return Turn::Device;
        }
        let is_trying = !self.tried[0].is_empty();
        if is_trying || n_drawn >= FEW && n_drawn > MANY * self.load {
            self.load = self.load.max(n_drawn);
            return Turn::Both;
        }
        if self.is_device_faster { Turn::Device } else { Turn::Processor }
    }

    /// A photograph that both compared, milliseconds.
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
        self.medians = Some(ComparerTrial { processor, device });
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_faster_one_is_kept_until_there_is_much_more_to_do() {
        let mut trial = Trial::new(ComparerPolicy::Fastest);
        assert_eq!(trial.turn(FEW - 1), Turn::Processor);
        let tried = |trial: &mut Trial, n_drawn, processor, device| {
            for _ in 0..N_TRIALS {
                assert_eq!(trial.turn(n_drawn), Turn::Both);
                trial.measured(processor, device);
            }
            trial.turn(n_drawn)
        };
        assert_eq!(tried(&mut trial, FEW, 3.0, 4.0), Turn::Processor);
        assert_eq!(trial.turn(2 * FEW), Turn::Processor);
        assert_eq!(tried(&mut trial, 2 * FEW + 1, 6.0, 5.0), Turn::Device);
        assert_eq!(trial.medians, Some(ComparerTrial { processor: 6.0, device: 5.0 }));
        assert_eq!(trial.turn(1), Turn::Device);
    }

    #[test]
    fn one_slow_photograph_decides_nothing() {
        let mut trial = Trial::new(ComparerPolicy::Fastest);
        for device in [50.0, 1.0, 60.0, 1.0] {
            assert_eq!(trial.turn(FEW), Turn::Both);
            trial.measured(2.0, device);
        }
        assert_eq!(trial.turn(FEW), Turn::Device);
        assert_eq!(Trial::new(ComparerPolicy::Device).turn(0), Turn::Device);
    }
}
