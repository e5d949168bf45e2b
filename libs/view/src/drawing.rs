//! Draws the vector graphics that senders of live images may add over an image.

use crate::View;
use crate::draw::Canvas;
use granita_image::Draw;
use tiny_skia::{Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, PixmapMut, Stroke, Transform};

/// The width of lines in screen pixels.
const LINE: f32 = 2.0;
/// The number of sample lines in a row of pixels.
const LINES: usize = 4;
/// The largest cost of one drawing, in points and in edges times sample lines. A drawing that costs more ends there.
const MOST_STEPS: u64 = 1 << 23;

type Point = [f32; 2];

/// Draws `steps` over the view of an image whose data window begins at `origin` of the sheet.
///
/// Lines are two screen pixels wide at any zoom. Paths are filled by the nonzero rule. Colours are screen colours,
/// white by default, and alpha shows the image below. Points that are not finite are skipped, and so are steps
/// beyond a bound on the cost.
pub fn paint(canvas: &mut Canvas, view: &View, origin: (f64, f64), steps: &[Draw]) {
    let point = |[x, y]: Point| -> Option<Point> {
        let (x, y) = view.to_screen(origin.0 + f64::from(x), origin.1 + f64::from(y));
        // The exact position of a point far outside of the screen has no effect.
        (x.is_finite() && y.is_finite()).then(|| [x.clamp(-1e6, 1e6) as f32, y.clamp(-1e6, 1e6) as f32])
    };
    let height = canvas.height;
    let Some(mut screen) = PixmapMut::from_bytes(&mut canvas.bytes, canvas.width, height) else { return };
    let mut colors = [[1.0; 4]; 2];
    let mut kept = Vec::new();
    let mut parts: Vec<Vec<Point>> = Vec::new();
    let mut budget = MOST_STEPS;
    for step in steps {
        match step {
            Draw::Save => kept.push(colors),
            Draw::Restore => colors = kept.pop().unwrap_or(colors),
            Draw::FillColor(color) => colors[0] = *color,
            Draw::StrokeColor(color) => colors[1] = *color,
            Draw::BeginPath => parts.clear(),
            Draw::MoveTo(to) => parts.extend(point(*to).map(|to| vec![to])),
            Draw::LineTo(to) => match (parts.last_mut(), point(*to)) {
                (Some(part), Some(to)) => part.push(to),
                (None, Some(to)) => parts.push(vec![to]),
                (_, None) => {}
            },
            Draw::Fill | Draw::Stroke => {
                let fills = *step == Draw::Fill;
                let Some(left) = budget.checked_sub(cost(&parts, fills, height)) else { return };
                budget = left;
                let Some(path) = path(&parts, fills) else { continue };
                if fills {
                    let paint = solid(colors[0]);
                    screen.fill_path(&path, &paint, FillRule::Winding, Transform::identity(), None);
                } else {
                    let stroke = Stroke {
                        width: LINE,
                        line_cap: LineCap::Square,
                        line_join: LineJoin::Miter,
                        ..Stroke::default()
                    };
                    screen.stroke_path(&path, &solid(colors[1]), &stroke, Transform::identity(), None);
                }
            }
        }
    }
}

/// Returns the cost of a fill or a stroke: its points, and the sample lines of the screen that its edges cross. A line
/// has two edges.
fn cost(parts: &[Vec<Point>], fills: bool, height: u32) -> u64 {
    let lines = height as f32 * LINES as f32;
    let edge = |a: &Point, b: &Point| {
        let (top, bottom) = (a[1].min(b[1]) * LINES as f32, a[1].max(b[1]) * LINES as f32);
        let crossed = bottom.min(lines) - top.max(0.0);
        if crossed >= 0.0 { crossed as u64 + 1 } else { 0 }
    };
    let points: u64 = parts.iter().map(|part| part.len() as u64).sum();
    let open: u64 = parts.iter().flat_map(|part| part.windows(2)).map(|pair| edge(&pair[0], &pair[1])).sum();
    if !fills {
        return points + 2 * open;
    }
    let closing: u64 = parts.iter().filter_map(|part| Some(edge(part.last()?, part.first()?))).sum();
    points + open + closing
}

/// Returns the path of these points; `None` when it has no extent.
fn path(parts: &[Vec<Point>], closed: bool) -> Option<Path> {
    let mut path = PathBuilder::new();
    for part in parts.iter().filter(|part| part.len() > 1) {
        let ([x, y], rest) = (part[0], &part[1..]);
        path.move_to(x, y);
        rest.iter().for_each(|[x, y]| path.line_to(*x, *y));
        if closed {
            path.close();
        }
    }
    path.finish()
}

/// Returns the paint of a colour with alpha.
fn solid(color: [f32; 4]) -> Paint<'static> {
    let [r, g, b, a] = color.map(|c| if c.is_nan() { 0.0 } else { c.clamp(0.0, 1.0) });
    let mut paint = Paint { anti_alias: true, ..Paint::default() };
    paint.set_color(Color::from_rgba(r, g, b, a).unwrap_or(Color::TRANSPARENT));
    paint
}

#[cfg(test)]
mod tests {
    use super::*;

    fn black(side: u32) -> (Canvas, View) {
        let bytes = [0, 0, 0, 255].repeat((side * side) as usize);
        let view = View::fit(side, side, [0.0, 0.0, f64::from(side), f64::from(side)]);
        (Canvas::new(side, side, bytes), view)
    }

    fn path(points: &[Point]) -> Vec<Draw> {
        let mut steps = vec![Draw::BeginPath, Draw::MoveTo(points[0])];
        steps.extend(points[1..].iter().map(|p| Draw::LineTo(*p)));
        steps
    }

    #[test]
    fn enclosed_areas_are_filled() {
        let (mut canvas, view) = black(40);
        let mut steps = vec![Draw::FillColor([1.0, 0.0, 0.5, 1.0])];
        // The polygon is concave. Its notch reaches from above to the middle.
        steps.extend(path(&[[5.0, 5.0], [20.0, 20.0], [35.0, 5.0], [35.0, 35.0], [5.0, 35.0]]));
        steps.push(Draw::Fill);
        paint(&mut canvas, &view, (0.0, 0.0), &steps);
        assert_eq!((canvas.at(20, 30), canvas.at(7, 20)), ([255, 0, 128], [255, 0, 128]));
        assert_eq!((canvas.at(20, 10), canvas.at(3, 20), canvas.at(36, 20)), ([0; 3], [0; 3], [0; 3]));
        let on_the_edge = canvas.at(10, 10)[0];
        assert!((100..160).contains(&on_the_edge), "half of a pixel on a slope: {on_the_edge}");
    }

    #[test]
    fn lines_are_drawn_with_colour_and_alpha() {
        let (mut canvas, view) = black(40);
        let mut steps = vec![Draw::StrokeColor([0.0, 1.0, 0.0, 0.5]), Draw::Save];
        steps.push(Draw::StrokeColor([1.0, 0.0, 0.0, 1.0]));
        steps.extend(path(&[[10.0, 10.0], [30.0, 10.0], [30.0, 30.0]]));
        steps.extend([Draw::Stroke, Draw::Restore]);
        steps.extend(path(&[[10.0, 20.0], [20.0, 20.0]]));
        steps.push(Draw::Stroke);
        // These steps draw nothing and change nothing else.
        steps.extend([Draw::LineTo([f32::NAN, 3.0]), Draw::MoveTo([f32::INFINITY, 0.0]), Draw::Stroke]);
        steps.extend([Draw::BeginPath, Draw::Fill, Draw::Restore, Draw::LineTo([1.0, 1.0]), Draw::Fill]);
        paint(&mut canvas, &view, (0.0, 0.0), &steps);
        let red = [255, 0, 0];
        assert_eq!([canvas.at(20, 9), canvas.at(20, 10), canvas.at(30, 9), canvas.at(29, 25)], [red; 4]);
        assert_eq!((canvas.at(20, 8), canvas.at(20, 11)), ([0; 3], [0; 3]));
        // This pixel is drawn twice.
        assert_eq!(canvas.at(15, 20), [0, 192, 0]);
    }

    #[test]
    fn the_work_of_a_drawing_is_limited() {
        let white = |canvas: &Canvas| canvas.at(60, 60) == [255; 3];
        let square = path(&[[55.0, 55.0], [63.0, 55.0], [63.0, 63.0], [55.0, 63.0]]);
        // The long edges cross the whole screen beside the square.
        let zigzag: Vec<Point> =
            (0..2000).map(|i| [(i % 30) as f32, if i % 2 == 0 { -1e9 } else { 1e9 }]).collect();
        let (lines, edges) = (64 * LINES as u64, zigzag.len() as u64);
        let may = MOST_STEPS / ((lines + 2) * edges);
        for (times, expected) in [(may - 1, true), (may + 2, false)] {
            let (mut canvas, view) = black(64);
            let mut steps = path(&zigzag);
            steps.extend(vec![Draw::Fill; times as usize]);
            steps.extend(square.clone());
            steps.push(Draw::Fill);
            paint(&mut canvas, &view, (0.0, 0.0), &steps);
            assert_eq!(white(&canvas), expected, "after {times} times {edges} edges");
        }
        // Points have a cost wherever they are. A step that exceeds the rest of the budget is not begun.
        for y in [1e9, 63.0] {
            let (mut canvas, view) = black(64);
            let mut steps = path(&vec![[3.0, y]; 1 << 16]);
            steps.extend(vec![Draw::Stroke; 1 << 7]);
            steps.extend(square.clone());
            steps.push(Draw::Fill);
            paint(&mut canvas, &view, (0.0, 0.0), &steps);
            assert!(!white(&canvas));
        }
    }
}
