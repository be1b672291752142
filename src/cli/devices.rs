//! Attaches GPUs to a training run.

use super::args::{DeviceName, TrainArgs};
use super::failure::Failure;
use vbgs_studio::pipeline::session::Session;

/// Kind of work for a device; each kind has its own option.
#[derive(Clone, Copy, PartialEq, Eq)]
enum Task {
    /// Passes over frames.
    Passes,
    /// Seeds and sums of a scene's points.
    Points,
    /// Comparing photographs.
    Photographs,
}

/// Attaches the requested devices to the session.
pub fn attach(session: &mut Session, args: &TrainArgs) -> Result<(), Failure> {
    // Passes and points exclude each other in a run.
    let task = if Task::Points.is_needed(session) { Task::Points } else { Task::Passes };
    attach_one(session, task, args.device)?;
    attach_one(session, Task::Photographs, args.photometric_device)
}

fn attach_one(session: &mut Session, task: Task, asked: DeviceName) -> Result<(), Failure> {
    match asked {
        DeviceName::Gpu if !task.is_needed(session) => Err(Failure::Usage(format!(
            "{} gpu: expected a run that {}",
            task.option(),
            task.needs()
        ))),
        DeviceName::Cpu => Ok(()),
        // Drivers are not loaded if there is no work for them.
        DeviceName::Auto if !task.is_needed(session) => Ok(()),
        DeviceName::Auto | DeviceName::Gpu => attach_gpu(session, task, asked),
    }
}

impl Task {
    fn option(self) -> &'static str {
        match self {
            Self::Passes | Self::Points => "--device",
            Self::Photographs => "--photometric-device",
        }
    }

    /// True if the run has this kind of work.
    fn is_needed(self, session: &Session) -> bool {
        match self {
            Self::Passes => session.learner().pass_use().is_some(),
            Self::Points => session.learner().point_use().is_some(),
            Self::Photographs => session.learner().comparer_use().is_some(),
        }
    }

    fn needs(self) -> &'static str {
        match self {
            Self::Passes | Self::Points => {
                "supports a GPU, found one that does not; use it with --births seeds and --visibility projected, or with --preset paper, --precision mixed, --index grid, --statistics fused and at most 4 --candidates"
            }
            Self::Photographs => {
                "trains on photographs, found one that does not; use it with --photometric light or full"
            }
        }
    }
}

#[cfg(feature = "gui")]
fn attach_gpu(session: &mut Session, task: Task, asked: DeviceName) -> Result<(), Failure> {
    use vbgs_studio::render::gpu::adapters::{AdapterChoice, may_have_gpu};
    use vbgs_studio::render::gpu::headless::{HeadlessError, HeadlessGpu};
    use vbgs_studio::train::device_trial::DevicePolicy;

    let must = asked == DeviceName::Gpu;
    if !must && !may_have_gpu() {
        return Ok(());
    }
    let gpu = match HeadlessGpu::new(&AdapterChoice::Auto) {
        Err(HeadlessError::NoHardware { .. }) if must => HeadlessGpu::new(&AdapterChoice::Software),
        other => other,
    };
    let error = match gpu {
        Ok(gpu) => {
            let policy = if must { DevicePolicy::Device } else { DevicePolicy::Fastest };
            let handed = match task {
                Task::Passes => session.compute_on(Box::new(gpu.mixture()), policy),
                Task::Points => {
                    session.fit_on(Box::new(gpu.points()), policy);
                    Ok(())
                }
                Task::Photographs => {
                    session.compare_on(Box::new(gpu.comparer()), policy);
                    Ok(())
                }
            };
            let Err(error) = handed else { return Ok(()) };
            error.to_string()
        }
        Err(HeadlessError::NoHardware { .. }) if !must => return Ok(()),
        Err(error) => error.to_string(),
    };
    let option = task.option();
    if must {
        let error = anyhow::anyhow!("{option} gpu: {error}; {option} cpu needs none");
        return Err(Failure::failed(error));
    }
    let what = match task {
        Task::Passes | Task::Points => "trains",
        Task::Photographs => "compares photographs",
    };
    eprintln!("note: {error}: the processor {what}");
    Ok(())
}

/// Reports missing GPU support in builds without the `gui` feature.
#[cfg(not(feature = "gui"))]
fn attach_gpu(_: &mut Session, task: Task, asked: DeviceName) -> Result<(), Failure> {
    if asked == DeviceName::Auto {
        return Ok(());
    }
    Err(Failure::Usage(format!(
        "{} gpu: expected auto or cpu, since this build has no GPU support; build it with the feature gui",
        task.option()
    )))
}
