//! Waiting for what was submitted, with a limit: a lost or hung device never answers.

use super::faults::GpuFaults;
use std::sync::mpsc;
use std::time::Duration;

/// A GPU that takes longer than this is not coming back.
const PATIENCE: Duration = Duration::from_secs(30);

/// Waits for a submission; then the first bytes of the buffers are mapped, as many as are said.
///
/// # Errors
/// What wgpu or the driver said.
pub(super) fn wait_mapped(
    device: &wgpu::Device,
    faults: &GpuFaults,
    submission: wgpu::SubmissionIndex,
    maps: &[(&wgpu::Buffer, wgpu::MapMode, u64)],
) -> Result<(), String> {
    let (sender, receiver) = mpsc::sync_channel(maps.len());
    for &(buffer, mode, bytes) in maps {
        let sender = sender.clone();
        buffer.map_async(mode, ..bytes, move |result| {
            // The receiver is gone only when the wait below has already failed.
            let _ = sender.send(result);
        });
    }
    let patiently =
        wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(PATIENCE) };
    device.poll(patiently).map_err(|error| error.to_string())?;
    // The wait above has run all callbacks, or it never will.
    for result in receiver.try_iter() {
        result.map_err(|error| error.to_string())?;
    }
    match faults.take().into_iter().next() {
        Some(fault) => Err(fault.message),
        None => Ok(()),
    }
}
