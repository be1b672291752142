//! Orders from the window to the training thread.

use crate::app::edit::left_out::LeftOut;
use crate::app::rescue::Rescue;
use crate::app::state::{NoticeKind, Subject};
use crate::app::training::TrainSettings;
use crate::export::mapping::Mapping;
use crate::render::attributes::Attribute;
use std::path::PathBuf;
use std::sync::mpsc::SyncSender;

/// Order to the training thread.
#[derive(Clone, Debug)]
pub enum WorkerOrder {
    /// Use these settings for what is opened or reset from now on.
    TrainBy(Box<TrainSettings>),
    /// Open a subject; the demo is also trained at once.
    Open(Subject),
    /// Open the first path that can be opened, and list the others in a notice.
    OpenFirst(Vec<PathBuf>),
    /// Restart with the open subject, its cameras corrected by a calibration file.
    Calibrate(PathBuf),
    /// Train until paused or done.
    Train,
    /// Stop after the current frame.
    Pause,
    /// Train one frame.
    Step,
    /// Follow recordings, the open one and those opened next; or stop following.
    Follow(bool),
    /// Restart with the same subject.
    Reset,
    /// Restart with the same subject and other settings, and train at once.
    Retrain(Box<TrainSettings>),
    /// Write a checkpoint of the newest state; the snapshot reports the outcome by this number.
    Save(u64, PathBuf),
    /// Export the newest scene, with the mapping from native to plain splats and the splats left out by
    /// edits; the snapshot reports the outcome by this number.
    Export(u64, PathBuf, Mapping, LeftOut),
    /// Write a text to a file, under an unused name if it exists.
    WriteText(PathBuf, String),
    /// Rescue training that no checkpoint holds and send the outcome, because the window has crashed.
    Rescue(SyncSender<Rescue>),
    /// Stop, and store training that no checkpoint holds for the next window, because the program is
    /// terminated.
    StoreForNextWindow(SyncSender<Rescue>),
    /// Resume the run that the snapshot offers.
    ResumeAbandoned,
    /// Discard the offered run.
    DiscardAbandoned,
    /// Publish a notice of the window.
    Report(NoticeKind, String),
    /// Remove the notices of the window, because another adapter draws.
    ForgetReports,
    /// Deliver attributes of components with their splats from now on; `None` stops that.
    Watch(Option<Attribute>),
    /// Include the inspection of a component in snapshots; `None` stops that.
    Inspect(Option<u32>),
    /// Deliver all splats again, for a new window.
    Deliver,
}
