//! What compares photographs in a training run.

use super::args::PhotometricDevice;
use super::failure::Failure;
use vbgs_studio::pipeline::session::Session;

/// Hands the session what was asked for.
pub fn attach(session: &mut Session, asked: PhotometricDevice) -> Result<(), Failure> {
    let learns = session.learner().comparer_use().is_some();
    match asked {
        PhotometricDevice::Gpu if !learns => Err(Failure::Usage(
            "--photometric-device gpu: expected a run that learns from photographs, found one that does not; use it with --photometric light or full".to_owned(),
        )),
        PhotometricDevice::Cpu => Ok(()),
        // Drivers are not even loaded where there is nothing to compare.
        PhotometricDevice::Auto if !learns => Ok(()),
        PhotometricDevice::Auto | PhotometricDevice::Gpu => attach_gpu(session, asked),
    }
}

#[cfg(feature = "gui")]
fn attach_gpu(session: &mut Session, asked: PhotometricDevice) -> Result<(), Failure> {
    use vbgs_studio::render::gpu::adapters::AdapterChoice;
    use vbgs_studio::render::gpu::headless::{HeadlessError, HeadlessGpu};
    use vbgs_studio::train::comparer_use::ComparerPolicy;

    let must = asked == PhotometricDevice::Gpu;
    let gpu = match HeadlessGpu::new(&AdapterChoice::Auto) {
        Err(HeadlessError::NoHardware { .. }) if must => HeadlessGpu::new(&AdapterChoice::Software),
        other => other,
    };
    match gpu {
        Ok(gpu) => {
            let policy = if must { ComparerPolicy::Device } else { ComparerPolicy::Fastest };
            session.compare_on(Box::new(gpu.comparer()), policy);
            Ok(())
        }
        Err(error) if must => Err(Failure::failed(anyhow::anyhow!(
            "--photometric-device gpu: {error}; --photometric-device cpu needs none"
        ))),
        Err(HeadlessError::NoHardware { .. }) => Ok(()),
        Err(error) => {
            eprintln!("note: {error}: the processor compares photographs");
            Ok(())
        }
    }
}

/// Without the window compiled in, nothing speaks to a GPU.
#[cfg(not(feature = "gui"))]
fn attach_gpu(_: &mut Session, asked: PhotometricDevice) -> Result<(), Failure> {
    if asked == PhotometricDevice::Auto {
        return Ok(());
    }
    Err(Failure::Usage(
        "--photometric-device gpu: expected auto or cpu, since this build speaks to no GPU; build it with the feature gui".to_owned(),
    ))
}
