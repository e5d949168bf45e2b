//! The index of the manual, which is made from the tables of the code and from the headings and tables of the pages.

use crate::kept;
use crate::pages::{PageText, pages};
use granita_scene::attribute::{Scope, TABLE};
use granita_scene::interface;
use std::collections::{BTreeMap, BTreeSet};
use std::fmt::Write;

/// The page of the index, relative to `docs`.
const PAGE: &str = "index-of-terms.md";

/// Terms, and the headings of the sections that describe them.
const TERMS: &[(&str, &str)] = &[
    ("adaptive sampling", "light.md#records-and-interpolation"),
    ("alpha", "tutorials/outputs.md#alpha"),
    ("ambient occlusion", "light.md#indirect-light-occlusion-caustics"),
    ("animation", "scenes.md#motion-blur"),
    ("area light", "tutorials/lights.md#area-lights"),
    ("background", "tutorials/panoramas.md#background"),
    ("baking", "tutorials/subsurface.md#subsurface-scattering"),
    ("beauty camera", "shadows.md#maps-made-on-demand"),
    ("bias", "tutorials/shadows.md#spots-and-stripes-on-surfaces"),
    ("bound", "scenes.md#inputs-with-a-bound"),
    ("bucket", "attributes.md#of-cameras"),
    ("bump", "tutorials/displacement.md#bumps-or-displacement"),
    ("camera", "scenes.md#cameras-and-space"),
    ("caustics", "tutorials/caustics.md#caustics"),
    ("colour space", "maketx.md#colour"),
    ("common space", "language.md#coordinate-systems"),
    ("completions of shells", "install.md#what-is-inside"),
    ("compositing", "tutorials/outputs.md#outputs-and-compositing"),
    ("creases", "scenes.md#creases"),
    ("crop", "gelato.md#options"),
    ("Cryptomatte", "calls/frames.md#cryptomatte"),
    ("cube map", "textures.md#orientation"),
    ("database", "databases.md#spatial-databases"),
    ("deep pixels", "formats.md#deep-pixels-and-parts-of-openexr"),
    ("depth map", "shadows.md#shadow-maps"),
    ("depth of field", "gelato.md#blur-where-there-is-blur"),
    ("derivatives", "functions.md#derivatives"),
    ("displacement", "tutorials/displacement.md#displacement"),
    ("environment map", "tutorials/panoramas.md#panoramas"),
    ("environment variables", "processes.md#environment-variables"),
    ("exit status", "processes.md#exit-codes"),
    ("exposure", "tutorials/panoramas.md#exposure"),
    ("falloff", "tutorials/lights.md#falloff"),
    ("FLIP", "iv.md#comparing"),
    ("gamma", "tutorials/first-scene.md#the-first-scene"),
    ("generator", "scenes.md#input-and-generators"),
    ("geometry set", "rays.md#geometry-sets"),
    ("glass", "tutorials/mirrors-and-glass.md#mirrors-and-glass"),
    ("grid", "gelato.md#grid-dumps"),
    ("hair", "tutorials/hair.md#hair"),
    ("holdout", "tutorials/outputs.md#alpha"),
    ("indirect light", "light.md#indirect-light-occlusion-caustics"),
    ("layers of shaders", "calls/shaders.md#shaders-and-lights"),
    ("limits", "processes.md#limits"),
    ("live images", "live.md#live-images"),
    ("man pages", "install.md#what-is-inside"),
    ("materials of mesh files", "scenes.md#mesh-files"),
    ("MIP levels", "textures.md#tiff"),
    ("motion blur", "scenes.md#motion-blur"),
    ("noise in images", "howto.md#how-do-i-get-rid-of-noise"),
    ("panorama", "tutorials/panoramas.md#panoramas"),
    ("photons", "tutorials/caustics.md#caustics"),
    ("plugins", "cpp.md#c-programs-and-plugins"),
    ("premultiplied colours", "tutorials/outputs.md#alpha"),
    ("preview", "gelato.md#a-quick-look"),
    ("primitive variables", "calls/shapes.md#primitives"),
    ("Pyglet", "scenes.md#flat-files-and-scripts"),
    ("quantization", "gelato.md#images"),
    ("ray depth", "rays.md#what-ends-a-ray"),
    ("reflections", "tutorials/mirrors-and-glass.md#what-is-reflected"),
    ("safe mode", "gelato.md#scenes-from-strangers"),
    ("samples of a pixel", "tutorials/first-scene.md#the-first-scene"),
    ("scripts", "scenes.md#flat-files-and-scripts"),
    ("search paths", "processes.md#search-paths"),
    ("soft shadows", "tutorials/shadows.md#soft-shadows"),
    ("startup files", "gelato.md#what-is-read-first"),
    ("statistics", "gelato.md#statistics"),
    ("stereo", "gelato.md#two-eyes"),
    ("subsurface scattering", "tutorials/subsurface.md#subsurface-scattering"),
    ("texture system for other programs", "texture-api.md#textures-for-other-programs"),
    ("turntable", "gelato.md#a-model-without-a-scene"),
    ("units", "tutorials/lights.md#units"),
    ("volume shadow", "gelato.md#volume-shadows"),
    ("workers", "gelato.md#several-machines"),
];

/// The tools, and the pages with the tables of their options.
const TOOLS: [(&str, &str); 7] = [
    ("gelato", "gelato.md"),
    ("granita", "install.md"),
    ("gslc", "shaders.md"),
    ("imgtool", "imgtool.md"),
    ("iv", "iv.md"),
    ("maketx", "maketx.md"),
    ("topyg", "scenes.md"),
];

/// The entries of a part of the index: the names, each with its places as links.
type Entries = BTreeMap<String, BTreeSet<String>>;

/// Returns the anchor of a heading, as mdBook makes it.
fn anchor(heading: &str) -> String {
    let kept = heading.chars().filter(|c| c.is_alphanumeric() || matches!(c, ' ' | '-' | '_'));
    kept.map(|c| if c == ' ' { '-' } else { c }).collect::<String>().to_lowercase()
}

/// Returns the path of a page in links of the index.
fn path(page: &PageText) -> &str {
    page.name.strip_prefix("docs/").unwrap()
}

fn add(entries: &mut Entries, name: &str, shown: &str, target: &str) {
    entries.entry(name.to_owned()).or_default().insert(format!("[{shown}]({target})"));
}

fn attributes() -> Entries {
    let mut entries = Entries::new();
    for row in TABLE {
        let heading = match row.scope {
            Scope::Camera => "Of cameras",
            Scope::Output => "Of outputs",
            Scope::Global => "Of the scene, before `World`",
            Scope::Object => "Of objects and lights",
            Scope::Writer => "Of writers of scene files",
            Scope::ReadOnly => "To be asked for only",
        };
        let target = format!("attributes.md#{}", anchor(heading));
        add(&mut entries, &format!("`{}`", row.name), &heading.replace('`', ""), &target);
    }
    entries
}

fn calls(all: &[PageText]) -> Entries {
    let mut entries = Entries::new();
    for page in all.iter().filter(|page| page.name.starts_with("docs/calls/")) {
        for (_, heading) in
            page.headings().into_iter().filter(|(_, name)| interface::call_row(name).is_some())
        {
            add(
                &mut entries,
                &format!("`{heading}`"),
                title(page),
                &format!("{}#{}", path(page), anchor(heading)),
            );
        }
    }
    assert_eq!(entries.len(), interface::TABLE.len());
    entries
}

fn functions(all: &[PageText]) -> Entries {
    let mut entries = Entries::new();
    for page in all.iter().filter(|page| page.name.starts_with("docs/functions")) {
        let mut section = "";
        for (level, heading) in page.headings() {
            if level == 2 {
                section = heading;
            }
            for name in heading.split(", ").filter(|_| level == 3) {
                add(
                    &mut entries,
                    &format!("`{name}`"),
                    section,
                    &format!("{}#{}", path(page), anchor(heading)),
                );
            }
        }
    }
    entries
}

fn shaders(all: &[PageText]) -> Entries {
    let page = all.iter().find(|page| page.name == "docs/shaders.md").unwrap();
    let headings = page.headings();
    let first = headings.iter().position(|(_, name)| *name == "Bundled shaders").unwrap();
    let mut entries = Entries::new();
    for (_, name) in headings[first + 1..].iter().take_while(|(level, _)| *level == 3) {
        add(&mut entries, &format!("`{name}`"), "Bundled shaders", &format!("shaders.md#{}", anchor(name)));
    }
    entries
}

/// Returns the lines of a page that are rows of tables, with the headings that they stand under.
fn rows(page: &PageText) -> Vec<(&str, &str)> {
    let (mut heading, mut found) = ("", Vec::new());
    for (_, line) in page.prose() {
        if line.starts_with('#') {
            heading = line.trim_matches('#').trim();
        } else if line.starts_with('|') {
            found.push((heading, line));
        }
    }
    found
}

/// Returns the names between backquotes in the first cell of a row.
fn names(row: &str) -> Vec<&str> {
    let cell = row.trim_start_matches('|').split(" | ").next().unwrap_or_default();
    cell.split('`').skip(1).step_by(2).collect()
}

fn options(all: &[PageText]) -> Entries {
    let mut entries = Entries::new();
    for (tool, file) in TOOLS {
        let page = all.iter().find(|page| path(page) == file).unwrap();
        for (heading, row) in rows(page) {
            for name in names(row) {
                let option = name.split_whitespace().find(|word| *word != tool).unwrap_or_default();
                let is_option = option.strip_prefix('-').is_some_and(|o| o.starts_with(char::is_alphabetic));
                if is_option {
                    add(&mut entries, &format!("`{option}`"), tool, &format!("{file}#{}", anchor(heading)));
                }
            }
        }
    }
    entries
}

/// Returns the names in the first column of tables under some headings of a page, or under all.
fn first_column(all: &[PageText], file: &str, heading: &str) -> Entries {
    let page = all.iter().find(|page| path(page) == file).unwrap();
    let mut entries = Entries::new();
    for (_, row) in rows(page).into_iter().filter(|(at, _)| *at == heading) {
        for name in names(row) {
            add(&mut entries, &format!("`{name}`"), heading, &format!("{file}#{}", anchor(heading)));
        }
    }
    entries
}

/// Returns the first heading of a page.
fn title(page: &PageText) -> &str {
    page.headings().first().map_or("", |(_, heading)| heading)
}

fn terms(all: &[PageText]) -> Entries {
    let mut entries = Entries::new();
    for (term, target) in TERMS {
        let (file, place) = target.split_once('#').unwrap();
        let page = all.iter().find(|page| path(page) == file).unwrap_or_else(|| panic!("{target}: no page"));
        let headings = page.headings();
        let found = headings.iter().find(|(_, heading)| anchor(heading) == place);
        let (_, heading) = found.unwrap_or_else(|| panic!("{target}: no heading"));
        add(&mut entries, term, heading, target);
    }
    entries
}

#[test]
fn the_index_lists_all_names() {
    let mut all = pages();
    all.retain(|page| path(page) != PAGE);
    let mut text = String::from(
        "# Index\n\nAll names and the main terms of the manual, each with the sections that describe it. The parts are [terms](#terms), \
         [attributes](#attributes), [calls](#calls), [functions of shaders](#functions-of-shaders), [bundled shaders](#bundled-shaders), \
         [options](#options), [image formats](#image-formats) and [environment variables](#environment-variables). For tasks see \
         [How do I ...](howto.md).\n",
    );
    let parts = [
        ("Terms", terms(&all)),
        ("Attributes", attributes()),
        ("Calls", calls(&all)),
        ("Functions of shaders", functions(&all)),
        ("Bundled shaders", shaders(&all)),
        ("Options", options(&all)),
        ("Image formats", first_column(&all, "formats.md", "What is read and written")),
        ("Environment variables", first_column(&all, "processes.md", "Environment variables")),
    ];
    for (title, entries) in parts {
        assert!(entries.len() > 5, "{title}: {} entries", entries.len());
        let _ = write!(text, "\n## {title}\n\n");
        let mut sorted: Vec<_> = entries.into_iter().collect();
        sorted.sort_by_key(|(name, _)| name.trim_matches(['`', '-']).to_lowercase());
        for (name, places) in sorted {
            let places: Vec<String> = places.into_iter().collect();
            let _ = writeln!(text, "- {name}: {}", places.join(", "));
        }
    }
    kept(&format!("docs/{PAGE}"), &text);
}
