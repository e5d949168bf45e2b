//! Tests images that arrive in every layout and from any thread.

use super::*;
use proptest::prelude::*;

fn names(list: &[&str]) -> Vec<String> {
    list.iter().map(|n| (*n).to_owned()).collect()
}

#[test]
fn updates_accept_any_channel_layout() {
    let live = Live::default();
    live.create("a", 4, 3, &names(&["R", "G", "B"])).unwrap();
    let rect = PixelRect::at(1, 1, 2, 2);
    // The values are interleaved, as they are stored.
    let values: Vec<f32> = (0..13).map(|v| v as f32).collect();
    live.update("a", &[(0, 1, 3), (1, 2, 3), (2, 3, 3)], rect, &values).unwrap();
    assert_eq!(live.read("a", rect, &[0, 1, 2]).unwrap(), values[1..]);
    assert_eq!(live.read("a", rect, &[2, 0]).unwrap(), [3.0, 1.0, 6.0, 4.0, 9.0, 7.0, 12.0, 10.0]);
    assert_eq!(live.read("a", rect, &[1, 2]).unwrap(), [2.0, 3.0, 5.0, 6.0, 8.0, 9.0, 11.0, 12.0]);
    // Each channel is a plane, and the channels are in another order.
    live.update("a", &[(2, 0, 1), (0, 4, 1)], rect, &values).unwrap();
    assert_eq!(live.read("a", rect, &[0, 1, 2]).unwrap()[..6], [4.0, 2.0, 0.0, 5.0, 5.0, 1.0]);
    let (info, all) = live.snapshot("a").unwrap();
    assert_eq!((info.width, info.height, all.len()), (4, 3, 36));
    assert_eq!(all[..3], [0.0; 3]);
    // All pixels have the same value.
    live.update("a", &[(0, 7, 0)], PixelRect::at(0, 0, 4, 3), &values).unwrap();
    assert!(live.read("a", PixelRect::at(0, 0, 4, 3), &[0]).unwrap().iter().all(|v| *v == 7.0));
}

#[test]
fn invalid_images_and_updates_are_refused() {
    let live = Live::new(LiveLimits { bytes: 4000, images: 2, ..LiveLimits::default() });
    let rgb = names(&["R", "G", "B"]);
    assert!(matches!(
        live.create("a", 100, 100, &rgb),
        Err(ViewError::Limit { asked: 120_000, max: 4000, .. })
    ));
    assert!(matches!(live.create("a", u32::MAX, 1, &rgb), Err(ViewError::Limit { .. })));
    assert!(matches!(live.create("a", 0, 1, &rgb), Err(ViewError::Misuse { .. })));
    assert!(matches!(live.create("a", 1, 1, &[]), Err(ViewError::Misuse { .. })));
    assert!(matches!(live.create("a", 1, 1, &names(&["R", "R"])), Err(ViewError::Misuse { .. })));
    live.create("a", 18, 18, &rgb).unwrap();
    assert!(live.create("b", 10, 10, &rgb).is_err(), "together they are too large");
    live.create("a", 5, 5, &rgb).unwrap();
    live.create("b", 10, 10, &rgb).unwrap();
    assert!(matches!(live.create("c", 1, 1, &rgb), Err(ViewError::Limit { what: "images", .. })));
    assert_eq!(live.names(), ["a", "b"]);
    let pixel = PixelRect::at(4, 4, 1, 1);
    assert!(live.update("a", &[(0, 0, 1)], pixel, &[1.0]).is_ok());
    for (channels, rect, values) in [
        ((3, 0, 1), pixel, &[1.0][..]),
        ((0, 1, 1), pixel, &[1.0]),
        ((0, 0, 1), pixel, &[]),
        ((0, 0, usize::MAX), PixelRect::at(0, 0, 2, 2), &[1.0; 4]),
        ((0, usize::MAX, 1), PixelRect::at(0, 0, 2, 2), &[1.0; 4]),
        ((0, 0, 1), PixelRect::at(5, 4, 1, 1), &[1.0]),
        ((0, 0, 1), PixelRect::at(-1, 4, 1, 1), &[1.0]),
        ((0, 0, 1), PixelRect::at(4, 4, 0, 1), &[1.0]),
        ((0, 0, 0), PixelRect::EVERYWHERE, &[1.0]),
    ] {
        assert!(live.update("a", &[channels], rect, values).is_err(), "{channels:?} {rect:?}");
        assert!(live.read("a", rect, &[channels.0]).is_err() || pixel == rect || rect.width() == 2);
    }
    assert!(live.update("nosuch", &[], pixel, &[]).is_err() && live.read("nosuch", pixel, &[]).is_err());
}

#[test]
fn changes_are_reported_once_and_old_ones_as_the_whole_image() {
    let live = Live::default();
    live.create("a", 64, 64, &names(&["Y"])).unwrap();
    let first = live.generation("a");
    assert!(live.changes_since("a", first).is_empty());
    let rects: Vec<PixelRect> = (0..5).map(|i| PixelRect::at(i, i, 2, 2)).collect();
    for rect in &rects {
        live.update("a", &[(0, 0, 1)], *rect, &[1.0; 4]).unwrap();
    }
    assert_eq!(live.changes_since("a", first), rects);
    assert_eq!(live.changes_since("a", first + 3), rects[3..]);
    assert!(live.changes_since("a", live.generation("a")).is_empty());
    assert_eq!(live.changes_since("a", 0), [PixelRect::at(0, 0, 64, 64)], "who never looked must see all");
    for _ in 0..CHANGES {
        live.update("a", &[(0, 0, 1)], rects[0], &[2.0; 4]).unwrap();
    }
    assert_eq!(live.changes_since("a", first), [PixelRect::at(0, 0, 64, 64)]);
    assert_eq!(live.changes_since("a", first + 5).len(), CHANGES);
    let id = live.info("a").unwrap().id;
    live.create("a", 2, 2, &names(&["Y"])).unwrap();
    assert_ne!(live.info("a").unwrap().id, id);
    assert_eq!(live.generation("nosuch"), 0);
}

#[test]
fn marks_are_removed_when_their_pixels_arrive() {
    let live = Live::default();
    live.create("a", 64, 32, &names(&["Y"])).unwrap();
    let marks = || live.info("a").unwrap().marks;
    live.mark("a", PixelRect::at(0, 0, 16, 16));
    live.mark("a", PixelRect::at(0, 0, 16, 16));
    live.mark("a", PixelRect::at(56, 16, 16, 16));
    live.mark("a", PixelRect::at(99, 99, 16, 16));
    live.mark("nosuch", PixelRect::at(0, 0, 1, 1));
    assert_eq!(marks(), [PixelRect::at(0, 0, 16, 16), PixelRect::at(56, 16, 8, 16)]);
    live.update("a", &[(0, 0, 1)], PixelRect::at(0, 0, 15, 16), &[1.0; 240]).unwrap();
    assert_eq!(marks().len(), 2, "not all of it came");
    live.update("a", &[(0, 0, 1)], PixelRect::at(0, 0, 20, 16), &[1.0; 320]).unwrap();
    assert_eq!(marks(), [PixelRect::at(56, 16, 8, 16)]);
    live.lost("a", "the sender is gone");
    let info = live.info("a").unwrap();
    assert_eq!((info.marks.len(), info.note.as_deref()), (0, Some("the sender is gone")));
}

#[test]
fn drawings_are_replaced_or_extended() {
    let live = Live::default();
    live.create("a", 4, 4, &names(&["Y"])).unwrap();
    let drawing = || live.info("a").unwrap().drawing.to_vec();
    live.draw("a", true, &[Draw::BeginPath, Draw::MoveTo([0.0, 1.0])]).unwrap();
    live.draw("a", true, &[Draw::Stroke]).unwrap();
    assert_eq!(drawing(), [Draw::BeginPath, Draw::MoveTo([0.0, 1.0]), Draw::Stroke]);
    live.draw("a", false, &[Draw::Fill]).unwrap();
    assert_eq!(drawing(), [Draw::Fill]);
    assert!(matches!(live.draw("a", true, &[Draw::Fill; STEPS]), Err(ViewError::Limit { .. })));
    assert!(live.draw("nosuch", false, &[]).is_err());
    assert!(live.changes_since("a", 1).is_empty(), "no pixel changed");
}

#[test]
fn requests_reach_the_renderer_until_it_disconnects() {
    let live = Live::default();
    live.create("a", 4, 4, &names(&["Y"])).unwrap();
    assert!(live.requests("a").is_none() && !live.info("a").unwrap().takes_requests);
    let (to, from) = std::sync::mpsc::channel();
    live.answer("a", RequestSender::new(move |request| to.send(request).is_ok()));
    let sender = live.requests("a").unwrap();
    assert!(sender.send(Request::Center { x: 1, y: 2 }) && sender.send(Request::Abort));
    assert_eq!(from.iter().take(2).collect::<Vec<_>>(), [Request::Center { x: 1, y: 2 }, Request::Abort]);
    live.finish("a");
    assert!(live.requests("a").is_none() && live.info("a").unwrap().note.is_none());
    drop(from);
    assert!(!sender.send(Request::Abort));
}

#[test]
fn waiting_threads_are_woken_by_changes() {
    let live = Live::default();
    let told = Arc::new(AtomicU64::new(0));
    let count = told.clone();
    live.watch(move || {
        count.fetch_add(1, Ordering::Relaxed);
    });
    let seen = live.version();
    assert_eq!(live.wait(seen, Duration::ZERO), seen);
    let other = live.clone();
    let maker = std::thread::spawn(move || other.create("a", 1, 1, &names(&["Y"])));
    assert!(live.wait(seen, Duration::from_secs(20)) > seen);
    // Without a change, a thread ends its wait when it is woken and has something else to do.
    let seen = live.version();
    let (other, begin) = (live.clone(), std::time::Instant::now());
    let flag = std::sync::Arc::new(std::sync::atomic::AtomicBool::new(false));
    let set = flag.clone();
    std::thread::spawn(move || {
        set.store(true, std::sync::atomic::Ordering::SeqCst);
        other.wake();
    });
    let ends = || flag.load(std::sync::atomic::Ordering::SeqCst);
    assert_eq!(live.wait_unless(seen, Duration::from_secs(60), ends), seen);
    assert!(begin.elapsed() < Duration::from_secs(60));
    maker.join().unwrap().unwrap();
    assert_eq!(live.shown(), 0);
    live.show("a");
    assert_eq!(live.shown(), live.info("a").unwrap().id);
    live.wish("a", Wishes { zoom: 2, ..Wishes::default() });
    assert_eq!(live.info("a").unwrap().wishes.zoom, 2);
    live.close("a");
    live.close("a");
    assert_eq!((told.load(Ordering::Relaxed), live.names().len()), (4, 0));
}

proptest! {
    /// The pixels are those of the last accepted updates, whatever updates arrive.
    #[test]
    fn random_updates_give_the_pixels_of_a_plain_image(
        updates in prop::collection::vec(
            (0_usize..3, 0_usize..3, 0_usize..4, -2_i32..9, -2_i32..7, 0_u32..9, 0_u32..7),
            1..20,
        ),
    ) {
        let (width, height, n) = (7, 5, 3);
        let live = Live::default();
        live.create("a", width, height, &names(&["R", "G", "B"])).unwrap();
        let mut plain = vec![0.0_f32; (width * height) as usize * n];
        for (round, (index, offset, stride, x, y, w, h)) in updates.into_iter().enumerate() {
            let values: Vec<f32> = (0..200).map(|v| (round * 1000 + v) as f32).collect();
            let rect = PixelRect::at(x, y, w, h);
            let inside = x >= 0 && y >= 0 && w > 0 && h > 0 && x as u32 + w <= width && y as u32 + h <= height;
            let done = live.update("a", &[(index, offset, stride)], rect, &values);
            prop_assert_eq!(done.is_ok(), inside);
            if inside {
                for k in 0..(w * h) as usize {
                    let (px, py) = (x as usize + k % w as usize, y as usize + k / w as usize);
                    plain[(py * width as usize + px) * n + index] = values[offset + k * stride];
                }
            }
        }
        prop_assert_eq!(live.snapshot("a").unwrap().1, plain);
    }
}

#[test]
fn panels_are_kept_in_parts_within_their_limits() {
    let live =
        Live::new(LiveLimits { panel_bytes: 100, panel_parts: 3, name_bytes: 20, ..LiveLimits::default() });
    assert!(matches!(live.show_panel("a", "x", "{}"), Err(ViewError::Misuse { .. })));
    live.create("a", 2, 2, &names(&["R"])).unwrap();
    let panel = || live.info("a").unwrap().panel;
    assert!(panel().is_empty());
    let before = live.generation("a");
    live.show_panel("a", "light/1", "{\"on\":1}").unwrap();
    live.show_panel("a", "light/2", "{}").unwrap();
    assert!(live.generation("a") > before);
    let old = panel();
    live.show_panel("a", "light/1", "").unwrap();
    live.show_panel("a", "light/3", "").unwrap();
    assert_eq!((old.len(), panel().keys().cloned().collect::<Vec<_>>()), (2, vec!["light/2".to_owned()]));
    for part in ["b", "c"] {
        live.show_panel("a", part, "{}").unwrap();
    }
    for (part, text) in [("d", "{}".to_owned()), ("b", "x".repeat(200)), (&*"x".repeat(21), "{}".to_owned())]
    {
        assert!(matches!(live.show_panel("a", part, &text), Err(ViewError::Limit { .. })), "{part}");
    }
    assert_eq!(panel().len(), 3);
    // Space is free again after a part was replaced or removed.
    for _ in 0..10 {
        live.show_panel("a", "b", &"x".repeat(60)).unwrap();
        live.show_panel("a", "b", "").unwrap();
    }
}

#[test]
fn edits_reach_the_sender_until_it_ends() {
    let live = Live::default();
    live.create("a", 2, 2, &names(&["R"])).unwrap();
    assert!(live.edits("a").is_none() && live.edits("b").is_none());
    let (to, from) = std::sync::mpsc::channel();
    live.take_edits("a", EditSender::new(move |text| to.send(text.to_owned()).is_ok()));
    assert!(live.edits("a").unwrap().send("{}"));
    assert_eq!(from.recv().unwrap(), "{}");
    live.finish("a");
    assert!(live.edits("a").is_none());
}
