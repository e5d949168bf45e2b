//! Checks the laws of `ARCHITECTURE.md` about imports between crates.

use crate::workspace::{Crate, Purpose, Workspace};
use std::path::Path;

/// The floors by folder. A crate imports strictly lower floors only (law 1).
const FLOORS: [(&str, u8); 37] = [
    ("libs/base", 0),
    ("libs/bundled", 0),
    ("libs/cli", 0),
    ("libs/farm", 0),
    ("libs/machine", 0),
    ("tests/browser", 0),
    ("libs/color", 1),
    ("libs/image", 1),
    ("libs/scene", 1),
    ("libs/gsl", 1),
    ("libs/geom", 1),
    ("libs/trace", 2),
    ("libs/sdb", 2),
    ("libs/texture", 2),
    ("libs/shade", 2),
    ("formats", 2),
    ("libs/dicing", 3),
    ("libs/plugin", 3),
    ("libs/view", 3),
    ("libs/edit", 4),
    ("libs/inputs", 4),
    ("libs/hider", 4),
    ("libs/rays", 4),
    ("tests/fixture", 4),
    ("libs/gpu", 5),
    ("libs/shading", 5),
    ("libs/render", 6),
    ("libs/session", 7),
    // This program contains all others.
    ("tools/granita", 9),
    ("tools", 8),
    ("bindings", 8),
    ("tests", 9),
    ("benches", 9),
    ("fuzz", 9),
    ("xtask", 9),
    ("examples", 9),
    ("docs", 9),
];

/// The imports inside one floor that are allowed, with the reason that `ARCHITECTURE.md` gives.
const SAME_FLOOR: [(&str, &str); 5] = [
    // The command-line crate reports with the types of base.
    ("granita-cli", "granita-base"),
    // One binary contains all tools, so that a scene can run the whole chain.
    ("gelato", "maketx"),
    ("gelato", "gslc"),
    ("gelato", "gsoinfo"),
    ("gelato", "topyg"),
];

/// The crates that may name a format crate (law 2).
const FORMAT_USERS: [(&str, &str); 9] = [
    ("granita-plugin", ""),
    ("granita-tests", ""),
    ("granita-fuzz", ""),
    ("granita-inputs", "granita-pyg"),
    ("granita-session", "granita-pyg"),
    ("topyg", "granita-pyg"),
    ("libgelato", "granita-pyg"),
    ("granita-benches", "granita-pyg"),
    ("iv", "granita-display"),
];

/// The external packages that only some crates may name (law 5).
const DOORS: [(&str, &[&str]); 9] = [
    ("ash", &["granita-gpu"]),
    ("obvhs", &["granita-gpu", "granita-benches"]),
    ("wgpu", &["granita-gpu", "iv"]),
    ("eframe", &["iv"]),
    ("egui", &["iv"]),
    ("libloading", &["granita-plugin"]),
    ("cc", &["granita-plugin"]),
    ("pulp", &["granita-machine"]),
    ("memmap2", &["granita-machine"]),
];

/// The imports that a crate must not have (laws 3, 4 and 9).
const STRANGERS: [(&str, &[&str]); 6] = [
    ("granita-shade", &["granita-texture", "granita-trace", "granita-scene", "granita-render"]),
    ("granita-hider", &["granita-geom", "granita-gsl", "granita-shade", "granita-trace"]),
    ("granita-rays", &["granita-gsl", "granita-texture"]),
    ("granita-gsl", &["granita-render", "granita-shade"]),
    ("granita-geom", &["granita-gsl", "granita-shade", "granita-scene"]),
    ("gelato", &["granita-view", "iv"]),
];

/// Returns all breaches, one line each.
pub(crate) fn check(workspace: &Workspace) -> Vec<String> {
    let mut faults = Vec::new();
    for from in &workspace.crates {
        let Some(floor) = floor(&from.folder) else {
            faults.push(format!(
                "{}: not in the floor table of xtask and ARCHITECTURE.md",
                from.folder.display()
            ));
            continue;
        };
        for dependency in &from.dependencies {
            let to = workspace.crates.iter().find(|c| c.name == dependency.name);
            if let Some(to) = to.filter(|_| dependency.purpose != Purpose::Tests) {
                check_floors(from, floor, to, &mut faults);
            }
            check_doors(from, &dependency.name, &mut faults);
            if let Some(to) = to.filter(|_| dependency.purpose != Purpose::Tests) {
                check_formats(from, to, &mut faults);
            }
            if STRANGERS
                .iter()
                .any(|(name, not)| *name == from.name && not.contains(&dependency.name.as_str()))
            {
                faults.push(format!("{} must not know {} (laws 3, 4 and 9)", from.name, dependency.name));
            }
        }
    }
    faults
}

/// Returns the floor of a crate in this folder.
pub(crate) fn floor(folder: &Path) -> Option<u8> {
    FLOORS.iter().find(|(prefix, _)| folder.starts_with(prefix)).map(|(_, floor)| *floor)
}

fn check_floors(from: &Crate, floor_of_from: u8, to: &Crate, faults: &mut Vec<String>) {
    let Some(to_floor) = floor(&to.folder) else { return };
    let exempt = SAME_FLOOR.contains(&(from.name.as_str(), to.name.as_str()));
    if to_floor >= floor_of_from && !exempt {
        faults.push(format!(
            "{} (floor {floor_of_from}) imports {} (floor {to_floor}): strictly lower floors only (law 1)",
            from.name, to.name
        ));
    }
}

fn check_formats(from: &Crate, to: &Crate, faults: &mut Vec<String>) {
    let allowed = FORMAT_USERS
        .iter()
        .any(|(user, format)| *user == from.name && (format.is_empty() || *format == to.name));
    if to.folder.starts_with("formats") && !allowed {
        faults.push(format!("{} names the format crate {} (law 2)", from.name, to.name));
    }
}

fn check_doors(from: &Crate, dependency: &str, faults: &mut Vec<String>) {
    let binding = from.folder.starts_with("bindings");
    for (package, users) in DOORS {
        if package == dependency && !users.contains(&from.name.as_str()) && !(binding && package == "cc") {
            faults.push(format!("{} names {package}: only {} may (law 5)", from.name, users.join(", ")));
        }
    }
}
