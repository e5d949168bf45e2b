//! The part that drives the page of the desk.

use crate::times::Times;
use crate::{Process, TURNS, Tools, desk};
use granita_browser::Page;
use serde_json::Value;
use std::path::Path;
use std::time::{Duration, Instant};

/// The script that records events and images in the page.
const RECORDER: &str = include_str!("recorder.js");
/// The size of the page, in which the image is shown one pixel for one, with a margin for lights beside it.
const SIZE: [u32; 2] = [1900, 900];
/// The number of events of a drag, and the interval between them.
const EVENTS: u32 = 45;
const INTERVAL: Duration = Duration::from_millis(33);

/// The time for which the image is looked at before the first drag.
const PAUSE: Duration = Duration::from_secs(10);

/// What is dragged.
enum Drag {
    /// The slider of a parameter of a light.
    Slider(&'static str, &'static str),
    /// The colour of a light, by events of its control, because the browser's picker is not part of the page.
    Color(&'static str, &'static str),
    /// The circle of a light in the image.
    Handle(&'static str),
}

const DRAGS: [(&str, Drag); 4] = [
    ("page: intensity of a light, shadow map", Drag::Slider("fill", "intensity")),
    ("page: colour of a light, shadow map", Drag::Color("fill", "lightcolor")),
    ("page: intensity of a light, traced shadows", Drag::Slider("rim-left", "intensity")),
    ("page: move a light, traced shadows", Drag::Handle("rim-left")),
];

/// Measures the page, or prints why it cannot be measured.
pub(crate) fn measure(tools: &Tools, place: &Path) -> Result<(), String> {
    let Some(browser) = granita_browser::find() else {
        println!("page: skipped, because there is no chromium or other browser");
        return Ok(());
    };
    let mut running = desk(tools, place, &[])?;
    let url = running.line("gelato: the desk is at ").ok_or("gelato ended without the address of a page")?;
    let profile = place.join("profile");
    std::fs::create_dir(&profile).map_err(|e| format!("{}: {e}", profile.display()))?;
    let mut page = Page::open(&browser, &profile, &url, SIZE)?;
    page.until("state().status === 'idle' && image && whole(image)")?;
    page.value(RECORDER)?;
    std::thread::sleep(PAUSE);
    for (what, drag) in &DRAGS {
        let mut times = Times::default();
        // The first drag, which is not counted, opens what the others use.
        for turn in 0..=TURNS {
            let taken = turns(&mut page, drag)?;
            if turn > 0 {
                add(&taken, &mut times)?;
            }
            page.value("edit({ do: 'undo' })")?;
            page.until("record.done()")?;
            page.value("record.take()")?;
        }
        times.print(what)?;
    }
    page.value("edit({ do: 'quit' })")?;
    wait(running);
    Ok(())
}

/// Waits until the desk has ended.
fn wait(mut running: Process) {
    let _ = running.child.wait();
}

/// Makes one drag. Returns what the page recorded.
fn turns(page: &mut Page, drag: &Drag) -> Result<Value, String> {
    let (Drag::Slider(light, _) | Drag::Color(light, _) | Drag::Handle(light)) = drag;
    page.value(&format!("desk.chosen = {light:?}; showDesk()"))?;
    page.until("record.done()")?;
    page.value("record.take()")?;
    match drag {
        Drag::Slider(_, param) => {
            let selector = format!(".lamp.open input[type=range][aria-label={param:?}]");
            page.value(&format!(
                "document.querySelector({selector:?}).scrollIntoView({{ block: 'center' }})"
            ))?;
            let middle = page.middle(&selector)?;
            paced(page, middle, [45.0, 0.0])?;
        }
        Drag::Handle(_) => {
            let middle = page.middle(".handle.chosen")?;
            paced(page, middle, [60.0, 10.0])?;
        }
        Drag::Color(_, param) => {
            let selector = format!(".lamp.open input[type=color][aria-label={param:?}]");
            let send = |page: &mut Page, kind: &str, blue: u32| {
                page.value(&format!(
                    "(() => {{ const c = document.querySelector({selector:?}); c.value = '#ff88{blue:02x}'; \
                     dispatchEvent(new Event({:?})); c.dispatchEvent(new Event({kind:?})); }})()",
                    if kind == "input" { "benchinput" } else { "pointerup" },
                ))
            };
            let begin = Instant::now();
            for k in 1..=EVENTS {
                send(page, "input", 4 * k)?;
                pause(begin, k);
            }
            send(page, "change", 4 * EVENTS)?;
        }
    }
    page.until("record.done()")?;
    page.value("record.take()")
}

/// Drags with the mouse at the pace of a hand.
fn paced(page: &mut Page, from: [f64; 2], by: [f64; 2]) -> Result<(), String> {
    let at = |k: u32| [0, 1].map(|i| from[i] + by[i] * f64::from(k) / f64::from(EVENTS));
    page.mouse("mousePressed", from)?;
    let begin = Instant::now();
    for k in 1..=EVENTS {
        page.mouse("mouseMoved", at(k))?;
        pause(begin, k);
    }
    page.mouse("mouseReleased", at(EVENTS))
}

/// Waits until the time of event `k + 1`.
fn pause(begin: Instant, k: u32) {
    std::thread::sleep((begin + k * INTERVAL).saturating_duration_since(Instant::now()));
}

/// Adds the times of a drag.
fn add(taken: &Value, times: &mut Times) -> Result<(), String> {
    let list = |name: &str| taken[name].as_array().cloned().unwrap_or_default();
    let (events, images) = (list("events"), list("images"));
    let number = |value: &Value| value["number"].as_u64();
    let time = |value: &Value| value["time"].as_f64().unwrap_or(f64::NAN);
    for (k, event) in events.iter().enumerate() {
        let shown = images.iter().find(|image| number(image) >= number(event));
        let shown = shown.ok_or_else(|| format!("no image shows {event}: {taken}"))?;
        if k == 0 {
            times.first.push(time(shown) - time(event));
        }
        times.events.push(time(shown) - time(event));
    }
    // The end of the drag is an edit of its own, after the last event.
    let last = events.last().and_then(number);
    let last = images.iter().find(|image| image["coarse"] == false && number(image) > last);
    let last = last.ok_or_else(|| format!("there is no final image: {taken}"))?;
    times.last.push(time(last) - taken["released"].as_f64().unwrap_or(f64::NAN));
    Ok(())
}
