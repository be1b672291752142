//! Restarts training with a calibration.

use super::thread::WorkerThread;
use crate::app::state::{GivenCalibration, Subject};
use crate::dataset::calibration::Calibration;
use crate::train::setting::Preset;
use std::path::Path;
use std::sync::Arc;

impl WorkerThread {
    pub(super) fn calibrate(&mut self, path: &Path) {
        let read = match self.calibratable() {
            Ok(subject) => {
                let file = path.to_owned();
                let read = self.read_cancellable(Some(path), move || Calibration::read(&file));
                read.and_then(|read| read.map_err(|error| error.to_string().into()))
                    .map(|calibration| (subject, calibration))
            }
            Err(why) => Err(format!("{}: {why}", path.display()).into()),
        };
        match read {
            Ok((subject, calibration)) => {
                let given = GivenCalibration { calibration, file: Some(path.to_owned()) };
                self.open_with(Some(Arc::new(given)), subject);
            }
            Err(refusal) => self.notify(refusal.kind, refusal.text),
        }
    }

    /// Subject to which a calibration applies, or the reason why there is none.
    fn calibratable(&self) -> Result<Subject, &'static str> {
        match &self.subject {
            None => Err("a calibration applies to a dataset: open the dataset first"),
            Some(Subject::Path(open)) if open.is_file() => {
                Err("a calibration applies to a dataset but a file is open: open its dataset first")
            }
            Some(_) if self.training.preset != Preset::Scene => Err(
                "the paper preset does not support a calibration: choose the scene preset in Settings first",
            ),
            Some(subject) => Ok(subject.clone()),
        }
    }
}
