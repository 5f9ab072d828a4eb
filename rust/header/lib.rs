//! The header of the stepper says what the library does.

#![cfg(test)]

use std::fs;
use std::path::Path;

#[test]
fn the_header_is_that_of_the_source() {
    let own = Path::new(env!("CARGO_MANIFEST_DIR")).join("../c");
    let config = cbindgen::Config::from_file(own.join("cbindgen.toml")).expect("a configuration");
    let made = cbindgen::Builder::new().with_config(config).with_src(own.join("src/stepper.rs")).generate();
    let mut text = Vec::new();
    made.expect("a header").write(&mut text);
    let (path, text) = (own.join("include/ambid.h"), String::from_utf8(text).expect("UTF-8"));
    if fs::read_to_string(&path).unwrap_or_default().replace('\r', "") != text {
        fs::write(&path, text).expect("writable");
        panic!("{} was not up to date, and has been written anew", path.display());
    }
}
