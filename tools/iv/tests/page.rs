//! Tests of the page of `iv -serve` in a headless browser, where one is installed.

#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test, with a line number")]

use base64::Engine;
use granita_base::Param;
use granita_browser::{PATIENCE, Page, Running};
use granita_display::{IvFormat, Packet};
use granita_image::{CreateOptions, Draw, Format, ImageSpec, Limits, PixelRect, PixelType, Pixels};
use serde_json::json;
use std::io::{BufRead, BufReader, Write};
use std::net::TcpStream;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Returns the pixels of a page as shown on the screen, of 600 x 400 pixels with three interleaved channels.
fn screenshot(page: &mut Page) -> Vec<f32> {
    let shot = page.call("Page.captureScreenshot", json!({"format": "png"})).unwrap();
    let png = base64::engine::general_purpose::STANDARD.decode(shot["data"].as_str().unwrap()).unwrap();
    let formats = granita_plugin::bundled_formats(Limits::default());
    let input = formats.open_bytes(Path::new("shot.png"), png.into()).unwrap();
    let spec = input.spec(0, 0).unwrap();
    assert_eq!((spec.width, spec.height), (600, 400));
    let n = spec.nchannels();
    let values = input.read_level(0, 0).unwrap().to_floats();
    values.chunks(n).flat_map(|pixel| pixel[..3].to_vec()).collect()
}

/// True when a pixel has about this colour on the screen. Its components are 0 to 255.
fn is_near(shot: &[f32], [x, y]: [usize; 2], color: [f32; 3]) -> bool {
    let pixel = &shot[(y * 600 + x) * 3..][..3];
    pixel.iter().zip(color).all(|(v, c)| (v * 255.0 - c).abs() <= 2.0)
}

/// Returns the centre of the image that the page shows; `None` when no image is visible. The image is fitted into the
/// space that the list (220 pixels) and the bars leave.
fn middle(shot: &[f32]) -> Option<[usize; 2]> {
    let inside = |x: usize, y: usize| !is_near(shot, [x, y], [17.0; 3]);
    let columns: Vec<usize> = (221..600).filter(|x| inside(*x, 200)).collect();
    let (first, last) = (*columns.first()?, *columns.last()?);
    let rows: Vec<usize> = (80..360).filter(|y| inside(first + 1, *y)).collect();
    let middle = [first.midpoint(last), rows.first()?.midpoint(*rows.last()?)];
    (middle[0] >= 261 && middle[0] < 560 && middle[1] >= 30 && middle[1] < 370).then_some(middle)
}

/// Returns what differs from the expected image of four colours.
fn fault(shot: &[f32]) -> Option<String> {
    let Some([x, y]) = middle(shot) else { return Some("no image".to_owned()) };
    // These are linear values, as encoded for sRGB.
    let colors = [
        ([x - 40, y - 30], [255.0, 0.0, 0.0]),
        ([x + 40, y - 30], [0.0, 188.0, 0.0]),
        ([x - 40, y + 30], [0.0, 0.0, 137.0]),
        ([x + 40, y + 30], [255.0, 0.0, 255.0]),
        ([x, y], [0.0, 255.0, 255.0]),
    ];
    let (at, color) = colors.into_iter().find(|(at, color)| !is_near(shot, *at, *color))?;
    Some(format!("{at:?}: {:?} instead of {color:?}", &shot[(at[1] * 600 + at[0]) * 3..][..3]))
}

/// Fills the ten pixels around the centre of an image of 100 x 80 with cyan, by vector graphics.
fn draw_square(display: &str, name: &str) {
    let mut commands =
        vec![Draw::FillColor([0.0, 1.0, 1.0, 1.0]), Draw::BeginPath, Draw::MoveTo([45.0, 35.0])];
    commands.extend([[55.0, 35.0], [55.0, 45.0], [45.0, 45.0]].map(Draw::LineTo));
    commands.push(Draw::Fill);
    let packet = Packet::VectorGraphics { name: name.to_owned(), focus: false, append: false, commands };
    let mut bytes = Vec::new();
    packet.encode(&mut bytes).unwrap();
    TcpStream::connect(display).unwrap().write_all(&bytes).unwrap();
}

/// Starts the viewer. Returns it, the address to which renderers connect, and the address of its page.
fn serve() -> (Running, String, String) {
    serve_with(&[])
}

/// Does the same with further options.
fn serve_with(words: &[&str]) -> (Running, String, String) {
    let mut iv = Command::new(env!("CARGO_BIN_EXE_iv"));
    let iv = iv.args(["-serve", "0", "-listen", "0"]).args(words).env_remove("OCIO");
    let iv = iv.stdout(Stdio::piped()).stdin(Stdio::null());
    let mut iv = Running(iv.spawn().unwrap());
    let mut lines = BufReader::new(iv.0.stdout.take().unwrap()).lines().map(Result::unwrap);
    let mut said = |what: &str| lines.find_map(|line| line.strip_prefix(what).map(str::to_owned)).unwrap();
    let display = said("iv: listening on ");
    let url = said("iv: serving ");
    (iv, display, url)
}

#[test]
fn the_page_shows_what_a_renderer_sends() {
    let Some(browser) = granita_browser::find() else {
        granita_needs::skip("chromium (or another browser)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let (_iv, display, url) = serve();
    // The image of 100 x 80 pixels has four colours. The last one is brighter than the screen and contains a NaN.
    let mut spec = ImageSpec::new(100, 80, 4, PixelType::Float);
    spec.attributes.set(Param::declared("string display", display.as_str()).unwrap());
    let format = IvFormat::default();
    let options = CreateOptions::new(&spec, 1);
    let mut image = format.create(Path::new("four colours"), &options).unwrap();
    for (x, y, color) in [
        (0, 0, [1.0, 0.0, 0.0, 1.0]),
        (50, 0, [0.0, 0.5, 0.0, 1.0]),
        (0, 40, [0.0, 0.0, 0.25, 1.0]),
        (50, 40, [8.0, f32::NAN, 0.0, 1.0]),
    ] {
        let rect = PixelRect::at(x, y, 50, 40);
        image.write_rectangle(&rect, &Pixels::Float(color.repeat(50 * 40))).unwrap();
    }
    image.close().unwrap();
    draw_square(&display, "four colours");
    // The page draws once with WebGL, and once without.
    for hash in ["", "#plain"] {
        let place = folder.path().join(format!("profile{hash}"));
        std::fs::create_dir(&place).unwrap();
        let mut page = Page::open(&browser, &place, &format!("{url}{hash}"), [600, 400]).unwrap();
        let begin = Instant::now();
        while let Some(fault) = fault(&screenshot(&mut page)) {
            assert!(begin.elapsed() < PATIENCE, "{hash} {fault}");
            std::thread::sleep(Duration::from_millis(50));
        }
        // With one stop more, half of the value is full brightness. The change by the page's own controls is visible.
        let brighter = "document.getElementById('exposure').value = 1; tuned()";
        page.value(brighter).unwrap();
        let shot = loop {
            let shot = screenshot(&mut page);
            if fault(&shot).is_some() || begin.elapsed() > PATIENCE {
                break shot;
            }
        };
        let [x, y] = middle(&shot).unwrap();
        assert!(is_near(&shot, [x + 40, y - 30], [0.0, 255.0, 0.0]), "{hash}");
        assert!(is_near(&shot, [x - 40, y + 30], [0.0, 0.0, 188.0]), "{hash}");
    }
}

/// Waits until the middle of the view of a page has this colour, from 0 to 255.
fn until_the_middle_is(page: &mut Page, color: [f32; 3], what: &str) {
    let begin = Instant::now();
    let place = "(() => { const r = view.getBoundingClientRect(); return [r.left + r.width / 2, r.top + r.height / 2]; })()";
    loop {
        let at = page.value(place).unwrap();
        let at = [0, 1].map(|i| at[i].as_f64().unwrap() as usize);
        let shot = screenshot(page);
        if is_near(&shot, at, color) {
            return;
        }
        let got = &shot[(at[1] * 600 + at[0]) * 3..][..3];
        assert!(begin.elapsed() < PATIENCE, "{what}: {got:?} instead of {color:?}");
        std::thread::sleep(Duration::from_millis(50));
    }
}

#[test]
fn pages_show_colours_through_the_views_that_are_chosen_in_them() {
    let Some(browser) = granita_browser::find() else {
        granita_needs::skip("chromium (or another browser)");
        return;
    };
    let folder = tempfile::tempdir().unwrap();
    let file = |name: &str, head: &str, pixel: Vec<u8>| {
        let path = folder.path().join(name);
        std::fs::write(&path, [head.as_bytes(), &pixel.repeat(100 * 80)].concat()).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let color = [0.18, 0.4, 0.05_f32];
    let linear = file("a.pfm", "PF\n100 80\n-1.0\n", color.iter().flat_map(|v| v.to_le_bytes()).collect());
    let bytes = file("a.ppm", "P6\n100 80\n255\n", vec![200, 128, 50]);
    let config = granita_color::Config::built_in();
    let seen = |view: &str, gain: f32| {
        let linear = config.processor("lin_rec709", "ACEScg").unwrap();
        let through = linear.then(&config.display_processor("ACEScg", "sRGB - Display", view).unwrap());
        through.map(color.map(|v| v * gain)).map(|v| v.clamp(0.0, 1.0) * 255.0)
    };
    let (_iv, _, url) = serve_with(&["-colorconfig", "ocio://default", &linear]);
    for hash in ["", "#plain"] {
        let place = folder.path().join(format!("profile{hash}"));
        std::fs::create_dir(&place).unwrap();
        let mut page = Page::open(&browser, &place, &format!("{url}{hash}"), [600, 400]).unwrap();
        page.until("colors.table && colors.managed").unwrap();
        until_the_middle_is(&mut page, seen("Un-tone-mapped", 1.0), hash);
        let text = page.value("document.getElementById('colors').textContent").unwrap();
        let expected = "linear, Rec. 709 (assumed); seen through sRGB - Display, Un-tone-mapped";
        assert_eq!(text, expected);
        let aces = "ACES 1.0 - SDR Video";
        page.value(&format!("$('through').value = '{aces}'; $('through').onchange()")).unwrap();
        until_the_middle_is(&mut page, seen(aces, 1.0), hash);
        page.value("$('exposure').value = 1; tuned()").unwrap();
        until_the_middle_is(&mut page, seen(aces, 2.0), hash);
        // The first view of another display.
        page.value("$('display').value = 'Rec.1886 Rec.709 - Display'; $('display').onchange()").unwrap();
        page.until("colors.state.display === 'Rec.1886 Rec.709 - Display' && $('through').value !== ''")
            .unwrap();
    }
    // Without a configuration there is no choice, and bytes have the colours of their file.
    let (_iv, _, url) = serve_with(&[&bytes]);
    let place = folder.path().join("profile of bytes");
    std::fs::create_dir(&place).unwrap();
    let mut page = Page::open(&browser, &place, &url, [600, 400]).unwrap();
    page.until("current && image").unwrap();
    until_the_middle_is(&mut page, [200.0, 128.0, 50.0], "bytes");
    assert_eq!(page.value("document.querySelector('label.look').hidden").unwrap(), true);
}

/// Returns the fraction of a part of a row of the screen that has one of these colours.
fn share(shot: &[f32], colors: &[[f32; 3]]) -> f32 {
    let found = (260..560).filter(|x| colors.iter().any(|color| is_near(shot, [*x, 200], *color))).count();
    found as f32 / 300.0
}

#[test]
fn large_images_show_all_their_pixels() {
    let Some(browser) = granita_browser::find() else {
        granita_needs::skip("chromium (or another browser)");
        return;
    };
    const RED: [f32; 3] = [255.0, 0.0, 0.0];
    const GREEN: [f32; 3] = [0.0, 255.0, 0.0];
    const BLUE: [f32; 3] = [0.0, 0.0, 255.0];
    let folder = tempfile::tempdir().unwrap();
    let (_iv, display, url) = serve();
    // The image has columns of red and blue. A reduced image has mixed colours.
    let mut spec = ImageSpec::new(8200, 120, 3, PixelType::Float);
    spec.attributes.set(Param::declared("string display", display.as_str()).unwrap());
    let columns: Vec<f32> = [1.0, 0.0, 0.0, 0.0, 0.0, 1.0].repeat(4100 * 120);
    let mut image = IvFormat::default().create(Path::new("columns"), &CreateOptions::new(&spec, 1)).unwrap();
    image.write_rectangle(&PixelRect::at(0, 0, 8200, 120), &Pixels::Float(columns)).unwrap();
    for hash in ["", "#plain"] {
        let place = folder.path().join(format!("profile{hash}"));
        std::fs::create_dir(&place).unwrap();
        let mut page = Page::open(&browser, &place, &format!("{url}{hash}"), [600, 400]).unwrap();
        let begin = Instant::now();
        page.until("document.getElementById('zoom')").unwrap();
        let evaluate = |page: &mut Page, code: &str| page.value(code).unwrap();
        let until = |page: &mut Page, what: &str, holds: &dyn Fn(&[f32], &str) -> bool| loop {
            let zoom = evaluate(page, "document.getElementById('zoom').textContent");
            let shot = screenshot(page);
            if holds(&shot, zoom.as_str().unwrap_or_default()) {
                return;
            }
            assert!(begin.elapsed() < PATIENCE, "{hash} {what}: {zoom}");
            std::thread::sleep(Duration::from_millis(50));
        };
        until(&mut page, "all", &|_, zoom| zoom.ends_with("reduced 3:1"));
        // Each pixel of the image covers eight pixels of the screen.
        let near = "scaleAt(200, view.clientHeight / 2, 8); 1";
        assert_eq!(evaluate(&mut page, near), 1);
        let full = |shot: &[f32], zoom: &str, colors: &[[f32; 3]]| {
            zoom == "800 %" && colors.iter().all(|c| share(shot, &[*c]) > 0.4) && share(shot, colors) > 0.99
        };
        until(&mut page, "columns", &|shot, zoom| full(shot, zoom, &[RED, BLUE]));
        // A change is visible at once, also in a part that was not visible before.
        image
            .write_rectangle(
                &PixelRect::at(0, 0, 8200, 120),
                &Pixels::Float([1.0, 0.0, 0.0, 0.0, 1.0, 0.0].repeat(4100 * 120)),
            )
            .unwrap();
        until(&mut page, "change", &|shot, zoom| full(shot, zoom, &[RED, GREEN]));
        evaluate(&mut page, "left -= 6000; draw()");
        std::thread::sleep(Duration::from_millis(300));
        until(&mut page, "elsewhere", &|shot, zoom| full(shot, zoom, &[RED, GREEN]));
        let blocks = evaluate(&mut page, "detail.list.length + (former ? 1000 : 0)");
        assert!((1..=4).contains(&blocks.as_u64().unwrap()), "{blocks}");
        evaluate(&mut page, "fitted = true; draw()");
        until(&mut page, "all again", &|_, zoom| zoom.ends_with("reduced 3:1"));
        image
            .write_rectangle(
                &PixelRect::at(0, 0, 8200, 120),
                &Pixels::Float([1.0, 0.0, 0.0, 0.0, 0.0, 1.0].repeat(4100 * 120)),
            )
            .unwrap();
    }
    image.close().unwrap();
}
