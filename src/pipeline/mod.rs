//! The one training loop. The window and the command line both drive [`session::Session`]: frames
//! are decoded and unprojected ahead on their own thread, trained one by one, and reported.

mod births;
pub mod checkpoint;
pub mod demo;
pub mod inspection;
pub mod learner;
pub mod machine;
pub mod memory;
pub mod plan;
pub mod prefetch;
pub mod prepare;
pub mod run;
pub mod session;
pub mod settings;
