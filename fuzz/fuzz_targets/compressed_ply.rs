#![no_main]

vbgs_fuzz::target!("compressed_ply");
