//! Conjugate distributions shared by both presets: Normal-Inverse-Wishart over position and colour, Dirichlet
//! over weights; with hyper-parameters, sufficient statistics and posterior.

pub mod niw;
pub mod posterior;
pub mod prior;
pub mod statistics;
