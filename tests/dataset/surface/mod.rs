//! Preparation of frames, against known planes, the oracle and real recordings.

mod agreement;
mod calibration;
mod drawn;
mod fates;
mod oracle;
mod planes;
