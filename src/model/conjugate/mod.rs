//! The conjugate laws that both presets share: Normal-Inverse-Wishart over position and colour,
//! Dirichlet over weights, their hyper-parameters, sufficient statistics and posterior.

pub mod dirichlet;
pub mod niw;
pub mod posterior;
pub mod prior;
pub mod statistics;
