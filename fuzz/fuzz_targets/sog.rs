#![no_main]

vbgs_fuzz::target!("sog");
