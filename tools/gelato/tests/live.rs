//! Tests of `gelato -display` and of images of the format "iv", with viewers in the test.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use granita_display::{Client, Ending, Listener, Packet, PacketLimits, ServerLimits, Sink};
use granita_image::{Limits, Request};
use parking_lot::Mutex;
use std::io::Read;
use std::net::TcpListener;
use std::path::Path;
use std::process::{Command, Stdio};
use std::sync::Arc;
use std::time::{Duration, Instant};

const SCENE: &str = r#"
Attribute ("int[2] resolution", (96, 64))
Attribute ("int[2] limits:bucketsize", (16, 16))
Output ("out.tif", "tiff", "rgba", "main", "int[4] quantize", (0, 0, 0, 0))
Output ("normals.tif", "tiff", "normal N", "main", "int[4] quantize", (0, 0, 0, 0))
Camera ("main")
World ()
Light ("sun", "distantlight")
Translate (0, 0, 4)
Shader ("surface", "plastic")
Sphere (1, -1, 1, 360)
Render ()
"#;

/// Runs gelato. Returns its exit status and its messages.
fn gelato(folder: &Path, words: &[&str]) -> (i32, String) {
    let output = Command::new(env!("CARGO_BIN_EXE_gelato"))
        .current_dir(folder)
        .args(words)
        .env("HOME", folder)
        .env_remove("GELATOHOME")
        .stdin(Stdio::null())
        .output()
        .unwrap();
    (output.status.code().unwrap(), String::from_utf8_lossy(&output.stderr).into_owned())
}

fn place(scene: &str) -> tempfile::TempDir {
    let place = tempfile::tempdir().unwrap();
    std::fs::write(place.path().join("scene.pyg"), scene).unwrap();
    place
}

fn floats(path: &Path) -> Vec<f32> {
    let formats = granita_plugin::bundled_formats(Limits::default());
    formats.open(path).unwrap().read_level(0, 0).unwrap().to_floats()
}

/// Images as packets make them: name, width, channels, pixels.
type Images = Vec<(String, usize, Vec<String>, Vec<f32>)>;

fn paint(images: &mut Images, packet: Packet) {
    match packet {
        Packet::CreateImage { name, width, height, channels, .. } => {
            let values = vec![f32::NAN; width as usize * height as usize * channels.len()];
            images.push((name, width as usize, channels, values));
        }
        Packet::UpdateImage { name, channels, rect, values, .. } => {
            let (_, width, names, pixels) = images.iter_mut().find(|p| p.0 == name).unwrap();
            for channel in channels {
                let c = names.iter().position(|n| *n == channel.name).unwrap();
                for k in 0..rect.width() * rect.height() {
                    let x = rect.x0 as usize + k % rect.width();
                    let y = rect.y0 as usize + k / rect.width();
                    pixels[(y * *width + x) * names.len() + c] =
                        values[channel.offset as usize + k * channel.stride as usize];
                }
            }
        }
        _ => (),
    }
}

/// Starts a viewer that never answers. Returns its address, and a thread that returns the images it received.
fn plain_viewer() -> (String, std::thread::JoinHandle<Images>) {
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap().to_string();
    let hearing = std::thread::spawn(move || {
        let mut all = Vec::new();
        server.accept().unwrap().0.read_to_end(&mut all).unwrap();
        let (mut rest, mut images) = (&all[..], Images::new());
        while let Some(length) = rest.first_chunk::<4>() {
            let (packet, after) = rest.split_at(u32::from_le_bytes(*length) as usize);
            assert!(packet[4] <= 8, "a packet of type {} that is not of the protocol", packet[4]);
            paint(&mut images, Packet::decode(packet, &PacketLimits::default()).unwrap());
            rest = after;
        }
        images
    });
    (address, hearing)
}

#[test]
fn a_viewer_receives_the_pixels_of_the_file_to_the_bit() {
    let place = place(SCENE);
    let (address, viewer) = plain_viewer();
    let ran = gelato(place.path(), &["-threads", "2", "-display", &address, "scene.pyg"]);
    assert_eq!(ran, (0, String::new()));
    let images = viewer.join().unwrap();
    let [(name, 96, channels, pixels)] = &images[..] else { panic!("{} images", images.len()) };
    assert_eq!((&**name, channels.concat()), ("scene.pyg", "RGBA".to_owned()));
    let file = floats(&place.path().join("out.tif"));
    assert!(*pixels == file && file.iter().any(|v| *v > 0.1));
}

#[test]
fn all_data_are_sent_as_pages_of_the_crop() {
    let place = place(SCENE);
    let (address, viewer) = plain_viewer();
    let words = ["-display", &address, "-data", "all", "-crop", "0.25", "1", "0.5", "1", "scene.pyg"];
    assert_eq!(gelato(place.path(), &words), (0, String::new()));
    let images = viewer.join().unwrap();
    let names: Vec<&str> = images.iter().map(|p| &*p.0).collect();
    assert_eq!(names, ["out.tif rgba", "normals.tif normal N"]);
    for (image, file) in images.iter().zip(["out.tif", "normals.tif"]) {
        assert_eq!((image.1, image.3.len()), (72, 72 * 32 * image.2.len()));
        assert!(image.3 == floats(&place.path().join(file)), "{file}");
    }
    // "first" is the first output. `-data` selects others.
    for (data, channels) in [("first", "RGBA"), ("z", "Z"), ("normal N", "RGB")] {
        let (address, viewer) = plain_viewer();
        let ran = gelato(place.path(), &["-display", &address, "-data", data, "scene.pyg"]);
        assert_eq!(ran, (0, String::new()));
        let images = viewer.join().unwrap();
        assert_eq!((&*images[0].0, images[0].2.concat()), ("scene.pyg", channels.to_owned()));
    }
}

#[test]
fn scenes_may_name_a_viewer_as_output() {
    let own = r#"Output ("live", "iv", "rgba", "main", "float gain", 2)
Camera ("main")"#;
    let place = place(&SCENE.replace("Camera (\"main\")", own));
    let (address, viewer) = plain_viewer();
    // The viewer of the command line is also that of the scene's output. Both share a connection.
    let ran = gelato(place.path(), &["-display", &address, "scene.pyg"]);
    assert_eq!(ran, (0, String::new()));
    let images = viewer.join().unwrap();
    assert_eq!((images.len(), &*images[0].0, &*images[1].0), (2, "live", "scene.pyg"));
    let twice = images[0].3.chunks(4).zip(images[1].3.chunks(4));
    assert!(twice.into_iter().all(|(a, b)| (0..3).all(|c| a[c] == 2.0 * b[c]) && a[3] == b[3]));
    // An untrusted scene may not name a viewer.
    let (named, viewer) = plain_viewer();
    let text = SCENE.replace(
        "Camera (\"main\")",
        &format!("Output (\"live\", \"iv\", \"rgba\", \"main\", \"string display\", \"{named}\")\nCamera (\"main\")"),
    );
    std::fs::write(place.path().join("named.pyg"), text).unwrap();
    let (status, said) = gelato(place.path(), &["-safe", "-display", "127.0.0.1:1024", "named.pyg"]);
    assert!(status == 0 && said.contains("may not name a viewer"), "{said}");
    assert!(said.contains("127.0.0.1:1024: no connection to the viewer"), "{said}");
    assert_eq!(gelato(place.path(), &["named.pyg"]), (0, String::new()));
    assert_eq!(viewer.join().unwrap().len(), 1);
}

#[test]
fn a_missing_viewer_is_one_warning_and_no_error() {
    let place = place(SCENE);
    let free = TcpListener::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    for (words, text) in [
        (["-display", &free], "no connection to the viewer"),
        (["-display", "a b"], "is not HOST[:PORT]"),
        (["-display", ":100x"], "is not HOST[:PORT]"),
    ] {
        let (status, said) = gelato(place.path(), &[&words[..], &["scene.pyg"]].concat());
        assert_eq!((status, said.matches("warning").count()), (0, 1), "{said}");
        assert!(said.contains(text), "{said}");
        assert!(place.path().join("out.tif").exists());
    }
}

/// A render with a viewer that hangs lasts longer by the time for which the viewer is waited for at the end. Its files
/// are complete before that.
#[test]
fn a_hanging_viewer_delays_only_the_end_of_the_run() {
    // The sphere is so near that it fills the image. Empty parts are sent as one pixel and would fit into the buffers
    // between the processes.
    let scene = SCENE.replace("(96, 64)", "(1536, 1024)").replace("(16, 16)", "(64, 64)");
    let place = place(&scene.replace("(0, 0, 4)", "(0, 0, 1.2)"));
    let server = TcpListener::bind("127.0.0.1:0").unwrap();
    let address = server.local_addr().unwrap().to_string();
    let begin = Instant::now();
    let (status, said) = gelato(place.path(), &["scene.pyg"]);
    let alone = begin.elapsed();
    assert_eq!((status, said.as_str()), (0, ""));
    let file = std::fs::read(place.path().join("out.tif")).unwrap();
    std::fs::remove_file(place.path().join("out.tif")).unwrap();
    let begin = Instant::now();
    let (status, said) = gelato(place.path(), &["-display", &address, "scene.pyg"]);
    let hung = begin.elapsed();
    let _socket = server.accept().unwrap();
    assert_eq!((status, said.matches("warning").count()), (0, 1), "{said}");
    assert!(said.contains("accepted nothing"), "{said}");
    assert!(hung < alone * 3 + Duration::from_secs(10), "{hung:?} instead of {alone:?}");
    assert!(std::fs::read(place.path().join("out.tif")).unwrap() == file);
}

/// A viewer of this suite that requests the end of the render after the first pixels.
#[derive(Default)]
struct Aborting {
    packets: Mutex<Vec<Packet>>,
}

impl Sink for Aborting {
    fn packet(&self, client: &Arc<Client>, packet: Packet) -> Result<(), String> {
        if let Packet::UpdateImage { name, .. } = &packet {
            client.send(Packet::Request { name: name.clone(), request: Request::Abort });
        }
        self.packets.lock().push(packet);
        Ok(())
    }

    fn trouble(&self, _: &Client, what: &str) {
        panic!("{what}");
    }

    fn gone(&self, _: &Client, ending: &Ending) {
        assert_eq!(*ending, Ending::Closed);
    }
}

#[test]
fn a_viewer_can_end_the_render() {
    // The frame has so many samples that the request arrives before it ends.
    let scene = SCENE
        .replace("(96, 64)", "(800, 600)")
        .replace("Camera (\"main\")", "Attribute (\"int[2] spatialquality\", (16, 16))\nCamera (\"main\")");
    let place = place(&scene);
    let sink = Arc::new(Aborting::default());
    let listener = Listener::bind(([127, 0, 0, 1], 0).into(), ServerLimits::default(), sink.clone()).unwrap();
    let words = ["-display", &listener.address().to_string(), "scene.pyg"];
    let (status, said) = gelato(place.path(), &words);
    assert_eq!(status, 1, "{said}");
    assert!(said.contains("rendering was stopped"), "{said}");
    assert!(!place.path().join("out.tif").exists());
    let begin = Instant::now();
    while listener.clients() > 0 {
        assert!(begin.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(5));
    }
    let packets = sink.packets.lock();
    assert!(matches!(
        &packets[..],
        [Packet::Hello { .. }, Packet::CreateImage { .. }, Packet::Mark { .. }, ..]
    ));
    assert!(matches!(packets.last(), Some(Packet::Finished { complete: false, .. })));
}

/// Workers make the same images and show nothing. The coordinator shows what they render.
#[test]
fn pixels_of_workers_are_shown() {
    let place = place(SCENE);
    let (address, viewer) = plain_viewer();
    let ran =
        gelato(place.path(), &["-net", "local local", "-display", &address, "-data", "all", "scene.pyg"]);
    assert_eq!(ran, (0, String::new()));
    let images = viewer.join().unwrap();
    assert_eq!(images.len(), 2);
    for (image, file) in images.iter().zip(["out.tif", "normals.tif"]) {
        assert!(image.3 == floats(&place.path().join(file)), "{file}");
    }
}

#[test]
fn our_viewer_receives_marks_of_begun_and_finished_buckets() {
    let place = place(SCENE);
    let sink = Arc::new(Recording::default());
    let listener = Listener::bind(([127, 0, 0, 1], 0).into(), ServerLimits::default(), sink.clone()).unwrap();
    let ran = gelato(place.path(), &["-display", &listener.address().to_string(), "scene.pyg"]);
    assert_eq!(ran, (0, String::new()));
    let begin = Instant::now();
    while listener.clients() > 0 {
        assert!(begin.elapsed() < Duration::from_secs(20));
        std::thread::sleep(Duration::from_millis(5));
    }
    let packets = sink.0.lock();
    let count = |test: fn(&Packet) -> bool| packets.iter().filter(|p| test(p)).count();
    assert_eq!(count(|p| matches!(p, Packet::CreateImage { name, .. } if name == "scene.pyg")), 1);
    assert_eq!(count(|p| matches!(p, Packet::Finished { complete: true, .. })), 1);
    assert_eq!(count(|p| matches!(p, Packet::UpdateImage { .. })), 24);
    assert_eq!(
        count(|p| matches!(p, Packet::Mark { .. })),
        count(|p| matches!(p, Packet::UpdateImage { .. }))
    );
    let mut images = Images::new();
    packets.iter().for_each(|packet| paint(&mut images, packet.clone()));
    assert!(images[0].3 == floats(&place.path().join("out.tif")));
}

/// A viewer of this suite that only records packets.
#[derive(Default)]
struct Recording(Mutex<Vec<Packet>>);

impl Sink for Recording {
    fn packet(&self, _: &Arc<Client>, packet: Packet) -> Result<(), String> {
        self.0.lock().push(packet);
        Ok(())
    }

    fn trouble(&self, _: &Client, what: &str) {
        panic!("{what}");
    }

    fn gone(&self, _: &Client, ending: &Ending) {
        assert_eq!(*ending, Ending::Closed);
    }
}
