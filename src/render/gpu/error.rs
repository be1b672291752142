//! Errors of the GPU renderer, with the requested amount, the adapter's limit and a remedy.

/// Failure of a GPU operation.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// The adapter cannot run the shaders.
    #[error(
        "{adapter}: {missing} required but not supported by this adapter; the CPU renderer draws instead"
    )]
    Unsupported {
        /// Name of the adapter.
        adapter: String,
        /// Missing feature.
        missing: &'static str,
    },
    /// The splats do not fit in one buffer of this adapter.
    #[error(
        "{n_splats} splats need {needed_mib} MiB, but this adapter binds at most {limit_mib} MiB: use at most {max_splats} splats or the CPU renderer"
    )]
    TooManySplats {
        /// Number of splats to upload.
        n_splats: usize,
        /// Size of their records, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader can bind completely, MiB.
        limit_mib: u64,
        /// Number of splats that would fit.
        max_splats: usize,
    },
    /// The driver refused an allocation that is within its limits.
    #[error(
        "{n_splats} splats: the GPU is out of memory ({mib} MiB requested); the previously uploaded splats are still drawn; close other GPU programs or train fewer components"
    )]
    OutOfMemory {
        /// Number of splats to upload.
        n_splats: usize,
        /// Total size of the requested buffers, MiB.
        mib: u64,
    },
    /// Comparing a photograph needs a larger buffer than this adapter supports.
    #[error(
        "comparing a photograph needs a buffer of {needed_mib} MiB, but this adapter binds at most {limit_mib} MiB; the processor compares instead"
    )]
    ComparisonTooLarge {
        /// Size of the buffer, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader can bind completely, MiB.
        limit_mib: u64,
    },
    /// The driver refused a buffer for comparing a photograph.
    #[error(
        "the GPU is out of memory for comparing a photograph ({mib} MiB requested); the processor compares instead; close other GPU programs to use the GPU"
    )]
    NoMemoryToCompare {
        /// Size of the requested buffer, MiB.
        mib: u64,
    },
    /// The result of comparing a photograph could not be read back.
    #[error("the GPU failed to compare a photograph: {reason}; the processor compares instead")]
    NoComparison {
        /// Message from wgpu or the driver.
        reason: String,
    },
    /// A pass over a frame needs a larger buffer than this adapter supports.
    #[error(
        "{what} need a buffer of {needed_mib} MiB, but this adapter binds at most {limit_mib} MiB; the processor trains instead"
    )]
    PassTooLarge {
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the buffer, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader can bind completely, MiB.
        limit_mib: u64,
    },
    /// The driver refused a buffer for a pass over a frame.
    #[error(
        "the GPU is out of memory for {what} ({mib} MiB requested); the processor trains instead; close other GPU programs to use the GPU"
    )]
    NoMemoryForPass {
        /// Contents of the buffer.
        what: &'static str,
        /// Size of the requested buffer, MiB.
        mib: u64,
    },
    /// The result of a pass over a frame could not be read back.
    #[error("the GPU failed to process a frame: {reason}; the processor trains instead")]
    NoPass {
        /// Message from wgpu or the driver.
        reason: String,
    },
    /// An image needs more splat-tile pairs than fit in GPU memory.
    #[error(
        "{needed} splat-tile pairs, but GPU memory holds {capacity}: the farthest splats are left out; make the window smaller or move the camera away"
    )]
    TooManyEntries {
        /// Number of splat-tile pairs in the image.
        needed: u64,
        /// Number of pairs drawn.
        capacity: u64,
    },
    /// An option, intended for comparisons, that the shaders do not support.
    #[error("{found} is not supported on the GPU; use the CPU renderer")]
    CpuOnly {
        /// The unsupported option.
        found: &'static str,
    },
    /// A draw order contains an invalid splat index: it belongs to another scene.
    #[error(
        "draw order contains splat {index}, but the scene has {n_splats}: sort the current splats again"
    )]
    StaleOrder {
        /// Invalid index.
        index: u32,
        /// Number of splats in the scene.
        n_splats: usize,
    },
    /// The viewport is larger than a texture may be.
    #[error(
        "viewport {width}x{height}: this adapter supports at most {limit} pixels per side; make the window smaller"
    )]
    ViewportTooLarge {
        /// Requested width, pixels.
        width: u32,
        /// Requested height, pixels.
        height: u32,
        /// Maximum side of a texture, pixels.
        limit: u32,
    },
    /// The photograph is larger than a texture may be.
    #[error(
        "photograph {width}x{height}: this adapter supports at most {limit} pixels per side; use smaller images"
    )]
    PhotoTooLarge {
        /// Width of the image, pixels.
        width: u32,
        /// Height of the image, pixels.
        height: u32,
        /// Maximum side of a texture, pixels.
        limit: u32,
    },
    /// An image could not be read back from the GPU.
    #[error("image of {width}x{height} could not be read back from the GPU: {reason}")]
    Readback {
        /// Width of the image, pixels.
        width: u32,
        /// Height of the image, pixels.
        height: u32,
        /// Message from wgpu.
        reason: String,
    },
}

/// Wraps the message of a failed pass over a frame.
pub(super) fn pass_failed(reason: String) -> GpuError {
    GpuError::NoPass { reason }
}
