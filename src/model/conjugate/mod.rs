//! Conjugate distributions shared by both presets: Normal-Inverse-Wishart over position and colour, and
//! Dirichlet over weights. Also their hyper-parameters, sufficient statistics and posterior.

pub mod niw;
pub mod posterior;
pub mod prior;
pub mod statistics;
