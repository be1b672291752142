//! Waits for submitted work with a timeout, because a lost or hung device never responds.

use super::faults::GpuFaults;
use std::sync::mpsc;
use std::time::Duration;

/// Timeout after which the GPU counts as lost.
const WAIT_TIMEOUT: Duration = Duration::from_secs(30);

/// Waits for a submission and maps buffers. Returns the first `bytes` bytes of `readback` and maps all
/// `uploads` completely for writing.
///
/// # Errors
/// Message from wgpu or the driver.
pub(super) fn wait_for_result<'a>(
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

/// Releases a mapped result and unmaps its readback buffer.
pub(super) fn release_result(answer: &mut Option<wgpu::BufferView>, readback: &wgpu::Buffer) {
    // The view is dropped first, because a buffer with a live view cannot be unmapped.
    if answer.take().is_some() {
        readback.unmap();
    }
}

/// Waits for a submission and maps the first bytes of each buffer, with mode and length as given.
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
            // The receiver is gone only if the wait below has already failed.
            let _ = sender.send(result);
        });
    }
    let patiently =
        wgpu::PollType::Wait { submission_index: Some(submission), timeout: Some(WAIT_TIMEOUT) };
    device.poll(patiently).map_err(|error| error.to_string())?;
    // All callbacks have run by now, or never will.
    for result in receiver.try_iter() {
        result.map_err(|error| error.to_string())?;
    }
    match faults.take_new().into_iter().next() {
        Some(fault) => Err(fault.message),
        None => Ok(()),
    }
}
