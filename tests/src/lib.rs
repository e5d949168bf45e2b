//! The suite runs whole tools on small files. Each case tests one issue.
//!
//! A case is a folder `tests/suite/AREA/NAME` with a file `case` and its inputs. The runner copies the folder to an
//! empty place, runs the lines of `case` there with the tools of this build, and compares the results. In order of
//! preference, a case shows that one scene equals another (`same`, `close`), that a number is correct (`pixel`,
//! `mean`), that a text equals its reference (`text`), or that an image equals its reference (`golden`). References are
//! in `tests/ref/AREA/NAME.*`. `cargo xtask bless AREA/NAME` replaces them.
//!
//! The lines of a `case` (`#` begins a comment):
//!
//! | line | meaning |
//! |---|---|
//! | `TOOL ARGUMENT ...` | runs `gelato`, `maketx`, `gslc`, `gsoinfo` or `topyg`, which must exit with status 0 |
//! | `exits N TOOL ...` | does the same with another exit status |
//! | `says TEXT` | the last run's standard output or error contains TEXT |
//! | `silent` | the last run left standard error empty |
//! | `absent FILE` | the file does not exist |
//! | `same A B` | two images have equal pixels, to the bit |
//! | `bytes A B` | two files have equal bytes |
//! | `differ A B` | two images differ in at least one pixel |
//! | `assembled WHOLE PART ...` | crops, put together, equal the whole image to the bit |
//! | `close A B TOLERANCE` | no channel of any pixel differs by more than TOLERANCE |
//! | `close A B TOLERANCE but N` | at most N pixels differ by more, for samples beside an edge |
//! | `pixel FILE X Y = V ... TOLERANCE` | the first channels of a pixel have these values |
//! | `mean FILE X0 Y0 X1 Y1 = V ... TOLERANCE` | the means over a box (right and lower side excluded) |
//! | `varied FILE` | not all pixels are equal |
//! | `finite FILE` | all values are finite numbers |
//! | `text stdout`, `text stderr`, `text FILE` | the text equals its reference, whose name a second word changes |
//! | `move FROM TO` | renames a file |
//! | `golden FILE TOLERANCE` | the image equals its reference (PNG) within the tolerance |

#![forbid(unsafe_code)]

mod case;
mod check;
pub mod fuzz;
mod image;
mod programs;
mod report;

pub use case::{Case, Line, Outcome, cases, run};
pub use image::Image;
pub use programs::{Ran, Tools, has_program, repository};
pub use report::write_report;

/// Texts of `examples/first` and their replacements in the copy of [`copy_first`]: fewer pixels, samples and rays.
const SMALL: [(&str, &str, &str); 9] = [
    ("first.pyg", "resolution\", (1280, 800)", "resolution\", (160, 100)"),
    ("first.pyg", "quality\", 100", "quality\", 16"),
    ("lights.pyg", "light:nsamples\", 25", "light:nsamples\", 2"),
    ("lights.pyg", "\"float samples\", 128", "\"float samples\", 8"),
    ("objects.pyg", "\"float samples\", 16", "\"float samples\", 1"),
    ("copper.gsl", "samples = 4", "samples = 1"),
    ("shadow.pyg", "resolution\", (1024, 1024)", "resolution\", (256, 256)"),
    ("bake.pyg", "resolution\", (640, 400)", "resolution\", (80, 50)"),
    ("fluff.pyg", "shadingquality\", 0.4", "shadingquality\", 0.1"),
];

/// Copies `examples/first` below `place`, with an image of an eighth of the width. The copy renders in about a second:
/// it has fewer samples and rays, and a ball takes the place of the rabbit, whose 3674 faces take most of the time of
/// a small image.
///
/// # Errors
/// Returns the files that cannot be copied.
pub fn copy_first(place: &std::path::Path) -> Result<(), String> {
    let told = |e: std::io::Error| format!("examples/first: {e}");
    let (from, to) = (repository().join("examples/first"), place.join("examples/first"));
    std::fs::create_dir_all(&to).map_err(told)?;
    for entry in std::fs::read_dir(from).map_err(told)? {
        let entry = entry.map_err(told)?;
        if entry.path().is_file() {
            std::fs::copy(entry.path(), to.join(entry.file_name())).map_err(told)?;
        }
    }
    for (file, large, small) in SMALL {
        let text = std::fs::read_to_string(to.join(file)).map_err(told)?;
        if !text.contains(large) {
            return Err(format!("{file} no longer contains {large}"));
        }
        std::fs::write(to.join(file), text.replace(large, small)).map_err(told)?;
    }
    let data = place.join("examples/data");
    std::fs::create_dir_all(&data).map_err(told)?;
    std::fs::write(data.join("rabbit.pyg"), "Translate (0, 4, 0)\nSphere (4, -4, 4, 360)\n").map_err(told)
}
