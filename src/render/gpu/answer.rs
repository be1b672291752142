//! Waiting for what was submitted, with a limit: a lost or hung device never answers.

use super::faults::GpuFaults;
use std::sync::mpsc;
use std::time::Duration;

/// A GPU that takes longer than this is not coming back.
const PATIENCE: Duration = Duration::from_secs(30);

/// Waits for a submission; then so many bytes of what comes back are mapped, and given, and all of the uploads
/// are.
///
/// # Errors
/// What wgpu or the driver said.
pub(super) fn answer_of<'a>(
    device: &wgpu::Device,
    faults: &GpuFaults,
    submission: wgpu::SubmissionIndex,
    (readback, bytes): (&'a wgpu::Buffer, u64),
    uploads: impl IntoIterator<Item = &'a wgpu::Buffer>,
) -> Result<wgpu::BufferView, String> {
    let mut maps = vec![(readback, wgpu::MapMode::Read, bytes)];
    maps.extend(uploads.into_iter().map(|upload| (upload, wgpu::MapMode::Write, upload.size())));
    wait_mapped(device, faults, submission, &maps)?;
    readback.get_mapped_range(..bytes).map_err(|error| error.to_string())
}

/// Lets go of an answer in the buffer that comes back.
pub(super) fn forget(answer: &mut Option<wgpu::BufferView>, readback: &wgpu::Buffer) {
    // The view first: a buffer that is still looked at cannot be unmapped.
    if answer.take().is_some() {
        readback.unmap();
    }
}

/// Waits for a submission; then the first bytes of the buffers are mapped, as many as are said.
fn wait_mapped(
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
