//! What can go wrong on the GPU, said with what was asked for, what the adapter has and what to do.

/// Why the GPU could not do what was asked.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum GpuError {
    /// The adapter cannot run the shaders at all.
    #[error(
        "{adapter}: expected {missing}, which this adapter does not offer; the CPU renderer draws instead"
    )]
    Unsupported {
        /// Name of the adapter.
        adapter: String,
        /// What it lacks.
        missing: &'static str,
    },
    /// More splats than one buffer of this adapter holds.
    #[error(
        "{n_splats} splats need {needed_mib} MiB, this adapter binds at most {limit_mib} MiB: keep to {max_splats} splats or draw with the CPU renderer"
    )]
    TooManySplats {
        /// Splats that were to be uploaded.
        n_splats: usize,
        /// Size of those splats' records, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader of this adapter sees whole, MiB.
        limit_mib: u64,
        /// What fits in it.
        max_splats: usize,
    },
    /// The driver refused an allocation that is within its limits.
    #[error(
        "{n_splats} splats: the GPU is out of memory ({mib} MiB asked for); the splats uploaded before are still drawn, close other GPU programs or train fewer components"
    )]
    OutOfMemory {
        /// Splats that were to be uploaded.
        n_splats: usize,
        /// Size of all buffers asked for, MiB.
        mib: u64,
    },
    /// Comparing a photograph needs a larger buffer than this adapter has.
    #[error(
        "comparing a photograph needs a buffer of {needed_mib} MiB, this adapter binds at most {limit_mib} MiB; the processor compares instead"
    )]
    ComparisonTooLarge {
        /// Size of the buffer, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader of this adapter sees whole, MiB.
        limit_mib: u64,
    },
    /// The driver refused a buffer for comparing a photograph.
    #[error(
        "the GPU is out of memory for comparing a photograph ({mib} MiB asked for); the processor compares instead, close other GPU programs to change that"
    )]
    NoMemoryToCompare {
        /// Size of the buffer asked for, MiB.
        mib: u64,
    },
    /// What a photograph says did not come back.
    #[error(
        "the GPU did not say what a photograph teaches: {reason}; the processor compares instead"
    )]
    NoComparison {
        /// What wgpu or the driver said.
        reason: String,
    },
    /// A pass over a frame needs a larger buffer than this adapter has.
    #[error(
        "{what} need a buffer of {needed_mib} MiB, this adapter binds at most {limit_mib} MiB; the processor trains instead"
    )]
    PassTooLarge {
        /// What was to be held.
        what: &'static str,
        /// Size of the buffer, MiB.
        needed_mib: u64,
        /// Largest buffer that a shader of this adapter sees whole, MiB.
        limit_mib: u64,
    },
    /// The driver refused a buffer for a pass over a frame.
    #[error(
        "the GPU is out of memory for {what} ({mib} MiB asked for); the processor trains instead, close other GPU programs to change that"
    )]
    NoMemoryForPass {
        /// What was to be held.
        what: &'static str,
        /// Size of the buffer asked for, MiB.
        mib: u64,
    },
    /// A pass over a frame did not come back.
    #[error("the GPU did not say what a frame teaches: {reason}; the processor trains instead")]
    NoPass {
        /// What wgpu or the driver said.
        reason: String,
    },
    /// An image needs more pairs of splat and tile than the GPU has room for.
    #[error(
        "{needed} pairs of splat and tile, this GPU has room for {capacity}: the farthest splats are left out; make the window smaller or come no closer"
    )]
    TooManyEntries {
        /// Pairs of splat and tile in the image.
        needed: u64,
        /// Of these are drawn.
        capacity: u64,
    },
    /// A setting for comparisons that the shaders do not have.
    #[error(
        "{found}: the GPU follows rays, up to where alpha ends; draw with the CPU renderer, which has this too"
    )]
    CpuOnly {
        /// What was asked for.
        found: &'static str,
    },
    /// An order names a splat that is not there: it belongs to another scene.
    #[error(
        "draw order names splat {index}, the scene holds {n_splats}: sort the current splats again"
    )]
    StaleOrder {
        /// Largest index in the order.
        index: u32,
        /// Splats in the scene.
        n_splats: usize,
    },
    /// The viewport is larger than a texture may be.
    #[error(
        "viewport {width}x{height}: this adapter draws at most {limit} pixels a side; make the window smaller"
    )]
    ViewportTooLarge {
        /// Columns asked for.
        width: u32,
        /// Rows asked for.
        height: u32,
        /// Pixels that a side of a texture may have at most.
        limit: u32,
    },
    /// The photograph is larger than a texture may be.
    #[error(
        "photograph {width}x{height}: this adapter shows at most {limit} pixels a side; compare with smaller images"
    )]
    PhotoTooLarge {
        /// Columns of the image, pixels.
        width: u32,
        /// Rows of the image, pixels.
        height: u32,
        /// Pixels that a side of a texture may have at most.
        limit: u32,
    },
    /// An image did not come back from the GPU.
    #[error("image of {width}x{height} did not come back from the GPU: {reason}")]
    Readback {
        /// Columns of the image, pixels.
        width: u32,
        /// Rows of the image, pixels.
        height: u32,
        /// What wgpu said.
        reason: String,
    },
}

/// What wgpu or the driver said of a pass over a frame that did not come back.
pub(super) fn no_pass(reason: String) -> GpuError {
    GpuError::NoPass { reason }
}
