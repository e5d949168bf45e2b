//! Safe interfaces to machine features that need unsafe code: vectors of numbers ([`simd`]), and mapped files and
//! large pages ([`memory`]).

pub mod memory;
pub mod simd;
