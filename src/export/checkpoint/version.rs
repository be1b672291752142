//! Version of the checkpoint format.

/// Version of the format that this program writes, major and minor. Scenes need 1.1.
pub const VERSION: (u16, u16) = (1, 1);
