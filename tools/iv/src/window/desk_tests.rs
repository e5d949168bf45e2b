//! Tests of what is looked at, without a window.

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

/// A desk with files of these sizes, and room for so many bytes of pictures that are not looked at.
fn desk(folder: &Path, sizes: &[(u32, u32)], others: u64) -> Desk {
    let formats = granita_plugin::bundled_formats(Limits::default());
    let files = (0..sizes.len()).map(|i| folder.join(format!("{i}.png"))).collect::<Vec<_>>();
    files.iter().zip(sizes).for_each(|(file, size)| write(file, &formats, *size));
    let store = TileStore::new(StoreLimits { others, ..StoreLimits::default() });
    Desk::new(formats, files, Live::default(), Display::default(), store, || ())
}

/// Frames until nothing is to be done any more.
fn settle(desk: &mut Desk) {
    for _ in 0..4 {
        desk.frame(200, 150);
        desk.loader.wait();
    }
    desk.frame(200, 150);
}

#[test]
fn the_next_picture_is_read_before_it_is_looked_at() {
    let folder = tempfile::tempdir().unwrap();
    let mut desk = desk(folder.path(), &[(300, 200); 5], 10 << 20);
    settle(&mut desk);
    assert!(desk.complete);
    let open = |desk: &Desk| (0..5).filter(|i| desk.entries.page(*i).is_some()).collect::<Vec<_>>();
    assert_eq!(open(&desk), [0, 1, 4]);
    for (action, expected) in [
        (Action::Next(1), &[0, 1, 2, 4][..]),
        (Action::Next(1), &[0, 1, 2, 3, 4]),
        (Action::Next(-1), &[0, 1, 2, 3, 4]),
    ] {
        desk.act(action);
        // The first frame of it is complete.
        desk.frame(200, 150);
        assert!(desk.complete);
        settle(&mut desk);
        assert_eq!(open(&desk), expected);
    }
}

#[test]
fn what_would_take_too_much_memory_is_not_read_ahead() {
    let folder = tempfile::tempdir().unwrap();
    let mut desk = desk(folder.path(), &[(100, 100), (1000, 1000), (110, 100)], 1 << 20);
    settle(&mut desk);
    let before = desk.store.bytes().1;
    assert!(before < 1 << 20, "{before}");
    desk.act(Action::Next(-1));
    desk.frame(200, 150);
    assert!(desk.complete);
    desk.act(Action::Next(-1));
    settle(&mut desk);
    assert!(desk.complete && desk.store.bytes().1 > 1 << 20);
}

/// "zoom" and "fullscreen" of a sender (reference 7.4.3).
#[test]
fn wishes_of_senders_are_shown_once() {
    let live = Live::default();
    live.create("render", 8, 8, &["R".to_owned()]).unwrap();
    live.wish("render", Wishes { fullscreen: true, zoom: 3, ..Wishes::default() });
    let formats = granita_plugin::bundled_formats(Limits::default());
    let store = TileStore::new(StoreLimits::default());
    let mut desk = Desk::new(formats, Vec::new(), live.clone(), Display::default(), store, || ());
    settle(&mut desk);
    assert_eq!(desk.view.zoom, 3.0);
    assert!(matches!(desk.pending.take(), Some(Errand::FullScreen)));
    // What is done to the view afterwards stays.
    desk.act(Action::Zoom(1.0));
    settle(&mut desk);
    assert!(desk.view.zoom == 1.0 && desk.pending.is_none());
    live.wish("render", Wishes { zoom: 2, ..Wishes::default() });
    settle(&mut desk);
    assert_eq!(desk.view.zoom, 2.0);
}

/// The desk of an iv that was started without files, which shows an image of 8 x 8 pixels. Its left half is white and opaque.
fn desk_of_a_render(wishes: Wishes) -> Desk {
    let live = Live::default();
    live.create("render", 8, 8, &["R", "G", "B", "A"].map(str::to_owned)).unwrap();
    let half = PixelRect::at(0, 0, 4, 8);
    live.update("render", &[0, 1, 2, 3].map(|c| (c, c, 4)), half, &[1.0; 4 * 8 * 4]).unwrap();
    live.wish("render", wishes);
    let files = granita_base::Files::reading([]);
    let formats = granita_plugin::bundled_formats(Limits { files, ..Limits::default() });
    let store = TileStore::new(StoreLimits::default());
    Desk::new(formats, Vec::new(), live, Display::default(), store, || ())
}

/// Files that clients name are readable, although the user named none (reference 7.4.3).
#[test]
fn files_of_senders_are_seen_below_and_above() {
    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("layer.png");
    write(&path, &granita_plugin::bundled_formats(Limits::default()), (8, 8));
    let name = path.to_str().unwrap().to_owned();
    let left_and_right = |desk: &mut Desk| {
        settle(desk);
        [desk.canvas.at(60, 75), desk.canvas.at(140, 75)]
    };
    let mut desk = desk_of_a_render(Wishes { background: name.clone(), ..Wishes::default() });
    assert_eq!(left_and_right(&mut desk), [[255; 3], [100; 3]]);
    let mut desk = desk_of_a_render(Wishes { foreground: name, ..Wishes::default() });
    assert_eq!(left_and_right(&mut desk), [[100; 3], [100; 3]]);
    let mut desk = desk_of_a_render(Wishes::default());
    desk.open_for_client(Wanted::Open {
        path: path.display().to_string(),
        selector: String::new(),
        focus: true,
    });
    assert_eq!(left_and_right(&mut desk), [[100; 3], [100; 3]]);
}
