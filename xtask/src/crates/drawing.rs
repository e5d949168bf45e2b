//! Draws the crates on their floors, for the architecture page.

use crate::laws;
use crate::workspace::{Crate, Purpose, Workspace};
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// The width of the drawing, in pixels.
const WIDTH: usize = 1200;
/// The height of a floor, in pixels.
const FLOOR: usize = 96;
/// The height of a crate, in pixels.
const BOX: usize = 30;
/// The space on the left for the numbers of floors, in pixels.
const LEFT: usize = 76;

/// Returns the drawing. The same crates and dependencies give the same bytes.
///
/// Lines lead from a crate to the crates that it imports. An import that another import of the crate implies has no
/// line.
pub(super) fn draw(workspace: &Workspace) -> String {
    let mut floors: BTreeMap<u8, Vec<&Crate>> = BTreeMap::new();
    for member in &workspace.crates {
        if let Some(floor) = laws::floor(&member.folder) {
            floors.entry(floor).or_default().push(member);
        }
    }
    let height = floors.len() * FLOOR + 20;
    let mut boxes = BTreeMap::new();
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {WIDTH} {height}\" font-family=\"sans-serif\" \
         font-size=\"12\">\n<title>Crates and floors</title>\n<rect width=\"{WIDTH}\" height=\"{height}\" fill=\"#fff\"/>\n"
    );
    for (row, (floor, members)) in floors.iter().rev().enumerate() {
        let top = 10 + row * FLOOR;
        let fill = if row % 2 == 0 { "#f4f1ec" } else { "#fff" };
        let _ = writeln!(text, "<rect y=\"{top}\" width=\"{WIDTH}\" height=\"{FLOOR}\" fill=\"{fill}\"/>");
        let _ =
            writeln!(text, "<text x=\"12\" y=\"{}\" fill=\"#777\">floor {floor}</text>", top + FLOOR / 2 + 4);
        let room = (WIDTH - LEFT) / members.len();
        for (at, member) in members.iter().enumerate() {
            let width = room.saturating_sub(8).min(130);
            let x = LEFT + at * room + (room - width) / 2;
            boxes.insert(member.name.as_str(), (x, top + (FLOOR - BOX) / 2, width));
        }
    }
    for (from, to) in edges(workspace) {
        if let (Some(&(x0, y0, w0)), Some(&(x1, y1, w1))) = (boxes.get(from), boxes.get(to)) {
            // A line within a floor joins the lower edges. Any other line leads from the lower edge to the upper one.
            let (y0, y1) = if y0 == y1 { (y0 + BOX, y1 + BOX) } else { (y0 + BOX, y1) };
            let (x0, x1) = (x0 + w0 / 2, x1 + w1 / 2);
            let bend = if y0 == y1 { y0 + 24 } else { usize::midpoint(y0, y1) };
            let _ = writeln!(
                text,
                "<path d=\"M{x0} {y0}C{x0} {bend} {x1} {bend} {x1} {y1}\" fill=\"none\" stroke=\"#8aa\"/>"
            );
        }
    }
    for (name, (x, y, width)) in &boxes {
        let short = name.strip_prefix("granita-").unwrap_or(name);
        let _ = writeln!(
            text,
            "<rect x=\"{x}\" y=\"{y}\" width=\"{width}\" height=\"{BOX}\" rx=\"5\" fill=\"#fff\" stroke=\"#355\"/>\
             <text x=\"{}\" y=\"{}\" text-anchor=\"middle\">{short}</text>",
            x + width / 2,
            y + 19
        );
    }
    text.push_str("</svg>\n");
    text
}

/// Returns the imports that no other import of the crate implies, in order.
fn edges(workspace: &Workspace) -> BTreeSet<(&str, &str)> {
    let imports: BTreeMap<&str, BTreeSet<&str>> = workspace
        .crates
        .iter()
        .map(|member| {
            let own = member.dependencies.iter().filter(|d| d.purpose == Purpose::Code);
            let names = own.filter_map(|d| workspace.crates.iter().find(|c| c.name == d.name));
            (member.name.as_str(), names.map(|c| c.name.as_str()).collect())
        })
        .collect();
    let mut edges = BTreeSet::new();
    for (&from, direct) in &imports {
        for &to in direct {
            if !direct.iter().any(|&other| other != to && reaches(&imports, other, to)) {
                edges.insert((from, to));
            }
        }
    }
    edges
}

fn reaches(imports: &BTreeMap<&str, BTreeSet<&str>>, from: &str, to: &str) -> bool {
    imports
        .get(from)
        .is_some_and(|direct| direct.contains(to) || direct.iter().any(|&next| reaches(imports, next, to)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::workspace::Dependency;

    #[test]
    fn the_drawing_has_each_crate_and_minimal_edges() {
        let dependency = |name: &str| Dependency {
            name: name.to_owned(),
            name_in_code: name.replace('-', "_"),
            purpose: Purpose::Code,
        };
        let member = |name: &str, folder: &str, needs: &[&str]| Crate {
            name: name.to_owned(),
            folder: folder.into(),
            dependencies: needs.iter().map(|name| dependency(name)).collect(),
            roots: Vec::new(),
        };
        let crates = vec![
            member("granita-base", "libs/base", &["glam"]),
            member("granita-scene", "libs/scene", &["granita-base"]),
            member("gelato", "tools/gelato", &["granita-base", "granita-scene"]),
        ];
        let workspace = Workspace { root: Default::default(), crates };
        assert_eq!(
            Vec::from_iter(edges(&workspace)),
            [("gelato", "granita-scene"), ("granita-scene", "granita-base")]
        );
        let text = draw(&workspace);
        for name in ["base", "scene", "gelato", "floor 0", "floor 8"] {
            assert!(text.contains(&format!(">{name}<")), "{name}");
        }
        assert_eq!(text.matches("<path").count(), 2);
    }
}
