//! Draws the vector graphics that senders of live images may add over an image.

use crate::View;
use crate::draw::Canvas;
use granita_image::Draw;

/// The width of lines in screen pixels.
const LINE: f32 = 2.0;
/// The number of sample lines in a row of pixels.
const LINES: usize = 4;
/// The largest cost of one drawing, in points and in edges times sample lines. A drawing that costs more ends there.
const MOST_STEPS: u64 = 1 << 23;

type Point = [f32; 2];

/// An edge of a filled area, directed downward, in sample lines. `turn` is 1 when it was directed downward before, else
/// -1.
struct Edge {
    top: f32,
    bottom: f32,
    /// The x coordinate in pixels at sample line 0, and the step from line to line.
    at: f32,
    slope: f32,
    turn: i32,
}

/// Draws `steps` over the view of an image whose data window begins at `origin` of the sheet.
///
/// Lines are two screen pixels wide at any zoom. Paths are filled by the nonzero rule. Colours are screen colours,
/// white by default, and alpha shows the image below. Points that are not finite are skipped, and so are steps
/// beyond a bound on the cost.
pub fn paint(canvas: &mut Canvas, view: &View, origin: (f64, f64), steps: &[Draw]) {
    let point = |[x, y]: Point| -> Option<Point> {
        let (x, y) = view.to_screen(origin.0 + f64::from(x), origin.1 + f64::from(y));
        // The exact position does not matter far outside of the screen.
        (x.is_finite() && y.is_finite()).then(|| [x.clamp(-1e6, 1e6) as f32, y.clamp(-1e6, 1e6) as f32])
    };
    let mut colors = [[1.0; 4]; 2];
    let mut kept = Vec::new();
    let mut path: Vec<Vec<Point>> = Vec::new();
    let mut budget = MOST_STEPS;
    for step in steps {
        if matches!(step, Draw::Fill | Draw::Stroke) {
            let points: u64 = path.iter().map(|part| part.len() as u64).sum();
            if points >= budget {
                return;
            }
            budget -= points;
        }
        match step {
            Draw::Save => kept.push(colors),
            Draw::Restore => colors = kept.pop().unwrap_or(colors),
            Draw::FillColor(color) => colors[0] = *color,
            Draw::StrokeColor(color) => colors[1] = *color,
            Draw::BeginPath => path.clear(),
            Draw::MoveTo(to) => path.extend(point(*to).map(|to| vec![to])),
            Draw::LineTo(to) => match (path.last_mut(), point(*to)) {
                (Some(part), Some(to)) => part.push(to),
                (None, Some(to)) => path.push(vec![to]),
                (_, None) => {}
            },
            Draw::Fill => {
                let mut edges = Vec::new();
                path.iter().for_each(|part| outline(part, &mut edges));
                fill(canvas, edges, colors[0], &mut budget);
            }
            Draw::Stroke => {
                let mut edges = Vec::new();
                for pair in path.iter().flat_map(|part| part.windows(2)) {
                    line(pair[0], pair[1], &mut edges);
                }
                fill(canvas, edges, colors[1], &mut budget);
            }
        }
    }
}

/// Appends the edges of a closed polygon.
fn outline(points: &[Point], edges: &mut Vec<Edge>) {
    for (i, a) in points.iter().enumerate() {
        let b = &points[(i + 1) % points.len()];
        let (up, down, turn) = if a[1] <= b[1] { (a, b, 1) } else { (b, a, -1) };
        let (top, bottom) = (up[1] * LINES as f32, down[1] * LINES as f32);
        if top < bottom {
            let slope = (down[0] - up[0]) / (bottom - top);
            edges.push(Edge { top, bottom, at: up[0] - top * slope, slope, turn });
        }
    }
}

/// Appends a line as a rectangle. All rectangles turn the same way. Each end is extended by a square so that corners
/// are whole.
fn line(a: Point, b: Point, edges: &mut Vec<Edge>) {
    let (dx, dy) = (b[0] - a[0], b[1] - a[1]);
    let length = dx.hypot(dy);
    let (ux, uy) = if length > 0.0 { (dx / length, dy / length) } else { (1.0, 0.0) };
    let (x, y) = (ux * LINE / 2.0, uy * LINE / 2.0);
    outline(
        &[
            [a[0] - x + y, a[1] - y - x],
            [b[0] + x + y, b[1] + y - x],
            [b[0] + x - y, b[1] + y + x],
            [a[0] - x - y, a[1] - y + x],
        ],
        edges,
    );
}

/// Fills the area that edges enclose.
fn fill(canvas: &mut Canvas, mut edges: Vec<Edge>, color: [f32; 4], budget: &mut u64) {
    let lines = canvas.height as usize * LINES;
    edges.retain(|e| e.bottom > 0.5 && e.top < lines as f32 - 0.5);
    let cost = |e: &Edge| (e.bottom.min(lines as f32) - e.top.max(0.0)) as u64 + 1;
    let steps: u64 = edges.iter().map(cost).sum();
    if steps > *budget {
        *budget = 0;
        return;
    }
    *budget -= steps;
    edges.sort_by(|a, b| a.top.total_cmp(&b.top));
    let width = canvas.width as usize;
    let (mut active, mut next) = (Vec::<usize>::new(), 0);
    let mut crossings: Vec<(f32, i32)> = Vec::new();
    let mut cover = vec![0.0_f32; width + 1];
    for y in 0..canvas.height as usize {
        if active.is_empty() && edges.get(next).is_none_or(|e| e.top > ((y + 1) * LINES) as f32) {
            if next == edges.len() {
                return;
            }
            continue;
        }
        let (mut first, mut last) = (width, 0);
        for n in y * LINES..(y + 1) * LINES {
            let middle = n as f32 + 0.5;
            while edges.get(next).is_some_and(|e| e.top <= middle) {
                active.push(next);
                next += 1;
            }
            active.retain(|i| edges[*i].bottom > middle);
            crossings.clear();
            crossings
                .extend(active.iter().map(|i| (edges[*i].at + edges[*i].slope * middle, edges[*i].turn)));
            crossings.sort_by(|a, b| a.0.total_cmp(&b.0));
            let mut turns = 0;
            for pair in crossings.windows(2) {
                turns += pair[0].1;
                if turns != 0 {
                    let (from, to) = (pair[0].0.clamp(0.0, width as f32), pair[1].0.clamp(0.0, width as f32));
                    span(&mut cover, from, to);
                    if from < to {
                        (first, last) = (first.min(from as usize), last.max((to.ceil() as usize).min(width)));
                    }
                }
            }
        }
        let row = &mut canvas.bytes[4 * y * width..][..4 * width];
        for x in first..last {
            let share = cover[x].min(1.0) * color[3].clamp(0.0, 1.0);
            cover[x] = 0.0;
            for (byte, c) in row[4 * x..4 * x + 3].iter_mut().zip(color) {
                let below = f32::from(*byte);
                *byte = (below + share * (255.0 * c.clamp(0.0, 1.0) - below) + 0.5) as u8;
            }
        }
    }
}

/// Adds a sample line from `from` to `to` to the coverage of each pixel.
fn span(cover: &mut [f32], from: f32, to: f32) {
    const SHARE: f32 = 1.0 / LINES as f32;
    if from >= to {
        return;
    }
    let (a, b) = (from as usize, to as usize);
    if a == b {
        cover[a] += (to - from) * SHARE;
        return;
    }
    cover[a] += (a as f32 + 1.0 - from) * SHARE;
    cover[a + 1..b].iter_mut().for_each(|c| *c += SHARE);
    cover[b] += (to - b as f32) * SHARE;
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
    fn what_is_enclosed_is_filled() {
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
    fn lines_colors_and_alpha() {
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
    fn a_drawing_costs_no_more_than_it_may() {
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
