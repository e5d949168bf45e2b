//! The part that drives the window of `iv`.

use crate::times::Times;
use crate::{Process, TURNS, Tools, desk};
use granita_benches::{Screen, find_program};
use std::path::Path;
use std::process::{Command, Stdio};

/// What is dragged: the name, the light, and the distance in pixels.
const DRAGS: [(&str, &str, [i32; 2]); 1] = [("window: move a light, traced shadows", "rim-left", [60, 10])];

/// Measures the window, or prints why it cannot be measured.
pub(crate) fn measure(tools: &Tools, place: &Path) -> Result<(), String> {
    if find_program("Xvfb").is_none() {
        println!("window: skipped, because there is no Xvfb");
        return Ok(());
    }
    let screen = Screen::start([1900, 800])?;
    for (what, light, [x, y]) in DRAGS {
        // The first drag, which is not counted, opens what the others use.
        let turn = format!("light {light} {x} {y} 1.5\nlatency\nlight {light} {} {} 1.5\nlatency\n", -x, -y);
        let script = format!("desk\nsleep 2\ndesk\n{}quit\n", turn.repeat(TURNS.div_ceil(2) + 1));
        std::fs::write(place.join("script.txt"), script).map_err(|e| e.to_string())?;
        let mut iv = Command::new(&tools.iv);
        iv.current_dir(place)
            .env("DISPLAY", &screen.name)
            .env_remove("WAYLAND_DISPLAY")
            .args(["-window", "1900", "760", "-listen", "0", "-script", "script.txt"])
            .stderr(Stdio::piped());
        let mut iv = Process::start(&mut iv)?;
        let Some(address) = iv.line("iv: listening on ") else {
            println!("window: skipped, because {}", errors(&mut iv));
            return Ok(());
        };
        let _gelato = desk(tools, place, &["-display", &address])?;
        let mut times = Times::default();
        for k in 0.. {
            let Some(report) = iv.line("latency: ") else { break };
            if k > 0 {
                add(&report, &mut times).ok_or_else(|| format!("iv reported \"{report}\""))?;
            }
        }
        if times.last.is_empty() {
            println!("window: skipped, because {}", errors(&mut iv));
            return Ok(());
        }
        times.print(what)?;
    }
    Ok(())
}

/// Returns the first line of the standard error of a process that has ended, or is about to.
fn errors(process: &mut Process) -> String {
    let mut text = String::new();
    if let Some(mut errors) = process.child.stderr.take() {
        let _ = std::io::Read::read_to_string(&mut errors, &mut text);
    }
    text.lines().next().unwrap_or("iv ended").to_owned()
}

/// Adds the times of a report; `None` when it has another form or an edit was not shown.
fn add(report: &str, times: &mut Times) -> Option<()> {
    let (edits, last) = report.strip_prefix("edits ")?.split_once("; final ")?;
    let edits = edits.split(' ').map(str::parse).collect::<Result<Vec<f64>, _>>().ok()?;
    times.first.push(*edits.first()?);
    times.events.extend(edits);
    times.last.push(last.parse().ok()?);
    Some(())
}
