//! The mixture itself: laws, hyper-parameters, statistics, posterior, and the splats it becomes.

pub mod splats;
