//! Measures the cost of showing an image while it is rendered, with a viewer that reads everything and with one that
//! reads nothing.

#![forbid(unsafe_code)]
#![allow(clippy::print_stdout, reason = "a table for a terminal")]

use granita_benches::{Cost, Fur, measure, release_tool, repository};
use std::io::Read;
use std::net::{SocketAddr, TcpListener};
use std::path::Path;
use std::process::{Command, ExitCode};
use std::sync::Arc;
use std::sync::atomic::{AtomicU64, Ordering};
use std::time::Duration;

/// The number of runs of each side. The sides alternate.
const TURNS: usize = 5;
/// The largest allowed ratio of the time with a viewer to the time without one.
const BAR: f64 = 1.02;

/// The scenes: one with large, expensive buckets, one with small, cheap ones, and one whose image is nearly empty.
const SCENES: [(&str, &str); 3] = [
    ("fur.pyg", "fur"),
    ("pot.pyg", "patches, traced shadows"),
    ("plain.pyg", "one sphere on 1920 x 1080 pixels, buckets of 16"),
];

fn main() -> ExitCode {
    granita_benches::exit("live", run())
}

fn run() -> Result<(), String> {
    let gelato = release_tool("gelato")?;
    let place = tempfile::tempdir().map_err(|e| e.to_string())?;
    let write = |name: &str, text: String| {
        std::fs::write(place.path().join(name), text).map_err(|e| format!("{name}: {e}"))
    };
    write("fur.pyg", Fur::default().scene())?;
    write("plain.pyg", PLAIN.to_owned())?;
    let pot = repository().join("benches/frames/pot.pyg");
    std::fs::copy(&pot, place.path().join("pot.pyg")).map_err(|e| format!("{}: {e}", pot.display()))?;
    let taken = Arc::new(AtomicU64::new(0));
    let viewer = viewer(taken.clone()).map_err(|e| e.to_string())?.to_string();
    println!("{:<52} {:>9} {:>9} {:>8} {:>7}", "scene", "alone, s", "shown, s", "MiB", "ratio");
    for (scene, about) in SCENES {
        let cost = |words: &[&str]| {
            measure(1, || {
                let mut command = Command::new(&gelato);
                command.current_dir(place.path()).args(["-silent", "-threads", "1"]).args(words).arg(scene);
                command
            })
        };
        let mut ratios = Vec::new();
        let mut best = [Duration::MAX; 2];
        let mut bytes = 0;
        for _ in 0..TURNS {
            let alone = processor(&cost(&[])?);
            let before = taken.load(Ordering::Relaxed);
            let shown = processor(&cost(&["-display", &viewer])?);
            bytes = taken.load(Ordering::Relaxed) - before;
            ratios.push(shown.as_secs_f64() / alone.as_secs_f64());
            best = [best[0].min(alone), best[1].min(shown)];
        }
        let [alone, shown] = best.map(|time| time.as_secs_f64());
        let ratio = shown / alone;
        println!(
            "{:<52} {alone:>9.2} {shown:>9.2} {:>8.1} {ratio:>6.3}x{}",
            format!("{scene}: {about}"),
            bytes as f64 / (1 << 20) as f64,
            if ratio <= BAR { "" } else { "  missed" }
        );
    }
    println!(
        "(processor time of one thread, with that of the thread that sends; best of {TURNS}; at most {BAR})"
    );
    hung(&gelato, place.path())
}

/// Measures the render itself, by its own clock, with a viewer that accepts the connection and reads nothing.
fn hung(gelato: &Path, place: &Path) -> Result<(), String> {
    let server = TcpListener::bind("127.0.0.1:0").map_err(|e| e.to_string())?;
    let address = server.local_addr().map_err(|e| e.to_string())?.to_string();
    let mut seconds = [f64::MAX; 2];
    for _ in 0..TURNS {
        for (best, words) in seconds.iter_mut().zip([&[][..], &["-display", &address][..]]) {
            let file = place.join("statistics.json");
            let mut command = Command::new(gelato);
            command.current_dir(place).args([
                "-silent",
                "-threads",
                "1",
                "-statistics-json",
                "statistics.json",
            ]);
            let status = command.args(words).arg("plain.pyg").status().map_err(|e| e.to_string())?;
            if !status.success() {
                return Err(format!("plain.pyg: {status}"));
            }
            let text = std::fs::read_to_string(&file).map_err(|e| e.to_string())?;
            *best = best.min(buckets_seconds(&text).ok_or("no seconds in the statistics")?);
        }
    }
    let [alone, hung] = seconds;
    println!(
        "a viewer that takes nothing: plain.pyg renders in {hung:.2} s, {alone:.2} s alone ({:.3}x)",
        hung / alone
    );
    Ok(())
}

/// Returns the seconds of the frame of the first camera, from the statistics.
fn buckets_seconds(text: &str) -> Option<f64> {
    let cameras = &text[text.find("\"cameras\"")?..];
    let rest = &cameras[cameras.find("\"frame\":")? + 8..];
    let number: String = rest.trim_start().chars().take_while(|c| c.is_ascii_digit() || *c == '.').collect();
    number.parse().ok()
}

/// Starts a server that reads everything from every connection. Returns its address.
fn viewer(taken: Arc<AtomicU64>) -> std::io::Result<SocketAddr> {
    let server = TcpListener::bind("127.0.0.1:0")?;
    let address = server.local_addr()?;
    std::thread::spawn(move || {
        let mut bytes = vec![0; 1 << 20];
        for mut socket in server.incoming().flatten() {
            while let Ok(n @ 1..) = socket.read(&mut bytes) {
                taken.fetch_add(n as u64, Ordering::Relaxed);
            }
        }
    });
    Ok(address)
}

/// Returns the processor time, or the wall clock time where the system does not provide it.
fn processor(cost: &Cost) -> Duration {
    cost.processor.unwrap_or(cost.wall)
}

const PLAIN: &str = r#"
Attribute ("int[2] resolution", (1920, 1080))
Attribute ("int[2] limits:bucketsize", (16, 16))
Output ("out.tif", "tiff", "rgba", "camera")
Translate (0, 0, 4)
World ()
Light ("key", "distantlight", "point from", (-1, 1, -1), "point to", (0, 0, 0))
Shader ("surface", "plastic")
Sphere (1, -1, 1, 360)
Render ()
"#;
