#![no_main]

vbgs_fuzz::target!("r3d");
