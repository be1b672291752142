//! What the window asks of the training thread.

use crate::app::edit::left_out::LeftOut;
use crate::app::rescue::Rescue;
use crate::app::state::{NoticeKind, Subject};
use crate::app::training::TrainSettings;
use crate::export::mapping::Mapping;
use crate::render::attributes::Attribute;
use std::path::PathBuf;
use std::sync::mpsc::SyncSender;

/// An order to the trainer.
#[derive(Clone, Debug)]
pub enum WorkerOrder {
    /// Train so what is opened or reset from now on.
    TrainBy(Box<TrainSettings>),
    /// Open something and, for the demo, train it at once.
    Open(Subject),
    /// Open the first of these that can be opened, and say which are left out.
    OpenFirst(Vec<PathBuf>),
    /// Start over with what is open, its cameras corrected by a file.
    Calibrate(PathBuf),
    /// Train until paused or done.
    Train,
    /// Stop after the current frame.
    Pause,
    /// Train one frame.
    Step,
    /// Take frames while they are recorded, of what is open and of what is opened next; or no longer.
    Follow(bool),
    /// Start over with the same subject.
    Reset,
    /// Start over with the same subject by other settings, and train at once.
    Retrain(Box<TrainSettings>),
    /// Write a checkpoint of the newest state; the snapshot tells the outcome by this number.
    Save(u64, PathBuf),
    /// Write the newest scene to a file, its outcome told by this number; how it becomes plain splats,
    /// where it is more, and what the user took out of it.
    Export(u64, PathBuf, Mapping, LeftOut),
    /// Write a text to a file, beside older ones of its name.
    WriteText(PathBuf, String),
    /// Save what no checkpoint holds yet and tell where: the window has crashed.
    Rescue(SyncSender<Rescue>),
    /// Stop, and keep what no checkpoint holds where the next window offers it: the program is ended.
    LeaveBehind(SyncSender<Rescue>),
    /// Go on with the run that an earlier window left behind, as the snapshot offers.
    GoOn,
    /// Remove that run.
    GiveUp,
    /// Show something that happened elsewhere in the window.
    Report(NoticeKind, String),
    /// What was shown so is no longer true: another adapter draws.
    ForgetReports,
    /// Deliver what is known of components with their splats, from now on; `None` ends that.
    Watch(Option<Attribute>),
    /// Keep what is known of a component in the snapshots; `None` ends that.
    Inspect(Option<u32>),
    /// Deliver all splats again, to a window that has none yet.
    Deliver,
}
