//! Tests of the model, without a window.

#![allow(clippy::unwrap_used, reason = "what fails here fails the test")]

use super::*;
use granita_image::{CreateOptions, ImageSpec, Limits, PixelType, Pixels};
use granita_view::StoreLimits;
use std::path::Path;

fn write(path: &Path, formats: &FormatRegistry, (width, height): (u32, u32)) {
    let spec = ImageSpec::new(width, height, 3, PixelType::U8);
    let mut file = formats.create(path, "png", &CreateOptions::new(&spec, 1)).unwrap();
    file.write_rows(&Pixels::U8(vec![100; (width * height * 3) as usize])).unwrap();
    file.close().unwrap();
}

/// Returns a model with files of these sizes. `others` is the memory for images that are not shown, in bytes.
fn model(folder: &Path, sizes: &[(u32, u32)], others: u64) -> Model {
    let formats = granita_plugin::bundled_formats(Limits::default());
    let files = (0..sizes.len()).map(|i| folder.join(format!("{i}.png"))).collect::<Vec<_>>();
    files.iter().zip(sizes).for_each(|(file, size)| write(file, &formats, *size));
    let store = TileStore::new(StoreLimits { others, ..StoreLimits::default() });
    Model::new(formats, files, Live::default(), Display::default(), store, || ())
}

/// Draws frames until all data is loaded.
fn settle(model: &mut Model) {
    for _ in 0..4 {
        model.frame(200, 150);
        model.loader.wait();
    }
    model.frame(200, 150);
}

#[test]
fn the_next_image_is_preloaded() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = model(folder.path(), &[(300, 200); 5], 10 << 20);
    settle(&mut model);
    assert!(model.complete);
    let open = |model: &Model| (0..5).filter(|i| model.entries.page(*i).is_some()).collect::<Vec<_>>();
    assert_eq!(open(&model), [0, 1, 4]);
    for (action, expected) in [
        (Action::Next(1), &[0, 1, 2, 4][..]),
        (Action::Next(1), &[0, 1, 2, 3, 4]),
        (Action::Next(-1), &[0, 1, 2, 3, 4]),
    ] {
        model.act(action);
        // The first frame of the new image is complete.
        model.frame(200, 150);
        assert!(model.complete);
        settle(&mut model);
        assert_eq!(open(&model), expected);
    }
}

#[test]
fn images_beyond_the_memory_limit_are_not_preloaded() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = model(folder.path(), &[(100, 100), (1000, 1000), (110, 100)], 1 << 20);
    settle(&mut model);
    let before = model.store.bytes().1;
    assert!(before < 1 << 20, "{before}");
    model.act(Action::Next(-1));
    model.frame(200, 150);
    assert!(model.complete);
    model.act(Action::Next(-1));
    settle(&mut model);
    assert!(model.complete && model.store.bytes().1 > 1 << 20);
}

/// Tests "zoom" and "fullscreen" of a sender (reference 7.4.3).
#[test]
fn zoom_and_fullscreen_of_senders_are_applied_once() {
    let live = Live::default();
    live.create("render", 8, 8, &["R".to_owned()]).unwrap();
    live.wish("render", Wishes { fullscreen: true, zoom: 3, ..Wishes::default() });
    let formats = granita_plugin::bundled_formats(Limits::default());
    let store = TileStore::new(StoreLimits::default());
    let mut model = Model::new(formats, Vec::new(), live.clone(), Display::default(), store, || ());
    settle(&mut model);
    assert_eq!(model.view.zoom, 3.0);
    assert!(matches!(model.pending.take(), Some(Command::FullScreen)));
    // Later changes of the view by the user stay.
    model.act(Action::Zoom(1.0));
    settle(&mut model);
    assert!(model.view.zoom == 1.0 && model.pending.is_none());
    live.wish("render", Wishes { zoom: 2, ..Wishes::default() });
    settle(&mut model);
    assert_eq!(model.view.zoom, 2.0);
}

/// Returns the model of an `iv` that was started without files and shows an image of 8 x 8 pixels. The left half of the
/// image is white and opaque.
fn desk_of_a_render(wishes: Wishes) -> Model {
    let live = Live::default();
    live.create("render", 8, 8, &["R", "G", "B", "A"].map(str::to_owned)).unwrap();
    let half = PixelRect::at(0, 0, 4, 8);
    live.update("render", &[0, 1, 2, 3].map(|c| (c, c, 4)), half, &[1.0; 4 * 8 * 4]).unwrap();
    live.wish("render", wishes);
    let files = granita_base::Files::reading([]);
    let formats = granita_plugin::bundled_formats(Limits { files, ..Limits::default() });
    let store = TileStore::new(StoreLimits::default());
    Model::new(formats, Vec::new(), live, Display::default(), store, || ())
}

/// Files that clients name are readable, although the user did not name any (reference 7.4.3).
#[test]
fn backgrounds_and_foregrounds_of_senders_are_shown() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("layer.png");
    write(&path, &granita_plugin::bundled_formats(Limits::default()), (8, 8));
    let name = path.to_str().unwrap().to_owned();
    let left_and_right = |model: &mut Model| {
        settle(model);
        [model.canvas.at(60, 75), model.canvas.at(140, 75)]
    };
    let mut model = desk_of_a_render(Wishes { background: name.clone(), ..Wishes::default() });
    assert_eq!(left_and_right(&mut model), [[255; 3], [100; 3]]);
    let mut model = desk_of_a_render(Wishes { foreground: name, ..Wishes::default() });
    assert_eq!(left_and_right(&mut model), [[100; 3], [100; 3]]);
    let mut model = desk_of_a_render(Wishes::default());
    model.open_for_client(Wanted::Open {
        path: path.display().to_string(),
        selector: String::new(),
        focus: true,
    });
    assert_eq!(left_and_right(&mut model), [[100; 3], [100; 3]]);
}

#[test]
fn files_that_are_not_shown_are_closed() {
    let folder = tempfile::tempdir().unwrap();
    let mut model = model(folder.path(), &[(8, 8); 40], 1 << 20);
    for entry in 0..40 {
        model.entries.open(entry, &model.formats, &model.store).unwrap();
    }
    let open: Vec<usize> = (0..40).filter(|i| model.entries.page(*i).is_some()).collect();
    let shown = std::iter::once(0);
    assert_eq!(open, shown.chain(17..40).collect::<Vec<_>>(), "the entry that is shown, and the last ones");
    model.act(Action::Next(1));
    model.entries.open(5, &model.formats, &model.store).unwrap();
    assert!(model.entries.page(0).is_none(), "it is not shown any more, and is the oldest");
}
