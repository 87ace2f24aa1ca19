//! Every operation's way back against finite differences of its definition in double precision.
//!
//! The loss is a weighted sum of the operation's output; inputs and parameters are sines. What is tolerated is 10⁻⁴ of the
//! largest derivative.

use super::attention::{Attended, Attention, AttentionScratch};
use super::layer_norm::{LayerNorm, Normed};
use super::linear::Linear;
use super::lookup::{LookedUp, Lookup, LookupScratch};
use super::one_token::NormedOne;
use super::*;

const TOLERANCE: f64 = 1e-4;

fn wave(count: usize, seed: f64) -> Vec<f32> {
    (0..count).map(|i| (0.61 * i as f64 + seed).sin() as f32).collect()
}

/// Features × columns, of which the first `count` mean something; the others are zero if they are `slopes`.
fn matrix(features: usize, count: usize, seed: f64, slopes: bool) -> Vec<f32> {
    let columns = lanes(count);
    let mut matrix = wave(features * columns, seed);
    if slopes {
        matrix.chunks_exact_mut(columns).for_each(|row| row[count..].fill(0.0));
    }
    matrix
}

/// The derivative of `loss` by every number of `at`.
fn differences(at: &[f32], loss: impl Fn(&[f64]) -> f64) -> Vec<f64> {
    const STEP: f64 = 1e-5;
    let start: Vec<f64> = at.iter().map(|&x| f64::from(x)).collect();
    let moved = |i: usize, far: f64| {
        let mut numbers = start.clone();
        numbers[i] += far;
        loss(&numbers)
    };
    (0..at.len()).map(|i| (moved(i, STEP) - moved(i, -STEP)) / (2.0 * STEP)).collect()
}

fn assert_close(what: &str, found: &[f32], expected: &[f64]) {
    let largest = expected.iter().fold(0.0_f64, |largest, x| largest.max(x.abs()));
    assert!(largest > 0.0, "{what} has no derivative");
    for (i, (found, expected)) in found.iter().zip(expected).enumerate() {
        let error = (f64::from(*found) - expected).abs();
        assert!(error <= TOLERANCE * largest, "{what} {i}: {found} instead of {expected}");
    }
}

/// `Σ slopes · y` over what means something.
fn weighted(slopes: &[f32], y: impl Iterator<Item = f64>) -> f64 {
    slopes.iter().zip(y).map(|(&slope, y)| f64::from(slope) * y).sum()
}

#[test]
fn a_dense_layer_has_the_derivatives_of_its_differences() {
    for (inputs, outputs, count) in [(3, 20, 5), (20, 3, 18), (16, 16, 1)] {
        let columns = lanes(count);
        let numbers = wave(outputs * inputs + outputs, 1.0);
        let x = matrix(inputs, count, 2.0, false);
        let slopes = matrix(outputs, count, 3.0, true);
        let mut layer =
            Linear::new(0..outputs * inputs, outputs * inputs..outputs * inputs + outputs);
        layer.load(&numbers);
        let loss = |numbers: &[f64], x: &[f64]| {
            let y = (0..outputs * columns).map(|index| {
                let (output, column) = (index / columns, index % columns);
                let terms =
                    (0..inputs).map(|k| numbers[output * inputs + k] * x[k * columns + column]);
                terms.sum::<f64>() + numbers[outputs * inputs + output]
            });
            weighted(&slopes, y)
        };
        let wide = |numbers: &[f32]| numbers.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();

        let mut gradient = vec![0.0; numbers.len()];
        let mut scratch = vec![0.0; lanes(inputs.min(outputs)) * count];
        layer.pull_weight(&x, &slopes, columns, count, &mut scratch, &mut gradient);
        layer.finish(&mut gradient);
        let (wide_x, wide_numbers) = (wide(&x), wide(&numbers));
        let expected = differences(&numbers, |numbers| loss(numbers, &wide_x));
        assert_close("parameter", &gradient, &expected);

        let mut x_slopes = vec![0.0; x.len()];
        layer.pull_input(&slopes, columns, false, &mut x_slopes);
        let expected = differences(&x, |x| loss(&wide_numbers, x));
        assert_close("input", &x_slopes, &expected);
    }
}

#[test]
fn a_norm_has_the_derivatives_of_its_differences() {
    let (features, count) = (7, 18);
    let columns = lanes(count);
    let numbers = wave(2 * features, 0.4);
    let x = matrix(features, count, 2.0, false);
    let slopes = matrix(features, count, 3.0, true);
    let mut norm = LayerNorm::new(0..features, features..2 * features);
    norm.load(&numbers);
    let loss = |numbers: &[f64], x: &[f64]| {
        let column = |c: usize| (0..features).map(move |k| x[k * columns + c]);
        let y = (0..features * columns).map(|index| {
            let (feature, c) = (index / columns, index % columns);
            let mean = column(c).sum::<f64>() / features as f64;
            let variance = column(c).map(|x| (x - mean).powi(2)).sum::<f64>() / features as f64;
            let scaled = (x[index] - mean) / (variance + 1e-5).sqrt();
            scaled * numbers[feature] + numbers[features + feature]
        });
        weighted(&slopes, y)
    };
    let wide = |numbers: &[f32]| numbers.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
    let (wide_x, wide_numbers) = (wide(&x), wide(&numbers));

    let (mut kept, mut y) = (Normed::new(features, columns), vec![0.0; x.len()]);
    norm.apply(&x, columns, &mut kept, &mut y);
    let (mut x_slopes, mut gradient) = (vec![0.0; x.len()], vec![0.0; numbers.len()]);
    norm.pull(&kept, &slopes, columns, &mut x_slopes, &mut gradient);
    assert_close("parameter", &gradient, &differences(&numbers, |n| loss(n, &wide_x)));
    assert_close("input", &x_slopes, &differences(&x, |x| loss(&wide_numbers, x)));
}

#[test]
fn attention_has_the_derivatives_of_its_differences() {
    // More queries than a block, keys that are not looked at, and heads of less than a vector.
    for (heads, head_width, queries, tokens, keys) in [(2, 4, 35, 20, 17), (1, 16, 3, 5, 5)] {
        let (width, query_columns, key_columns) =
            (heads * head_width, lanes(queries), lanes(tokens));
        let query = matrix(width, queries, 0.3, false);
        let (key, value) = (matrix(width, tokens, 1.1, false), matrix(width, tokens, 2.3, false));
        let slopes = matrix(width, queries, 3.7, true);
        let attention = Attention { width, heads, queries, query_columns, keys, key_columns };
        let loss = |query: &[f64], key: &[f64], value: &[f64]| {
            let mut mixed = vec![0.0; width * query_columns];
            for (head, q) in (0..heads).flat_map(|head| (0..queries).map(move |q| (head, q))) {
                let features = head * head_width..(head + 1) * head_width;
                let score = |k: usize| {
                    let terms = features
                        .clone()
                        .map(|f| query[f * query_columns + q] * key[f * key_columns + k]);
                    (terms.sum::<f64>() / (head_width as f64).sqrt()).exp()
                };
                let weights: Vec<f64> = (0..keys).map(score).collect();
                let sum: f64 = weights.iter().sum();
                for f in features.clone() {
                    let terms =
                        weights.iter().enumerate().map(|(k, w)| w * value[f * key_columns + k]);
                    mixed[f * query_columns + q] = terms.sum::<f64>() / sum;
                }
            }
            weighted(&slopes, mixed.into_iter())
        };
        let mut kept = Attended::new(heads, queries, key_columns);
        let mut scratch = AttentionScratch::new(head_width, query_columns.max(key_columns));
        let mut mixed = vec![0.0; query.len()];
        attention.apply([&query, &key, &value], &mut kept, &mut scratch, &mut mixed);
        let mut found = [vec![9.0; query.len()], vec![9.0; key.len()], vec![9.0; value.len()]];
        let [a, b, c] = &mut found;
        attention.pull([&query, &key, &value], &mixed, &slopes, &kept, &mut scratch, [a, b, c]);
        let wide = |numbers: &[f32]| numbers.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        let (q, k, v) = (wide(&query), wide(&key), wide(&value));
        assert_close("query", &found[0], &differences(&query, |x| loss(x, &k, &v)));
        assert_close("key", &found[1], &differences(&key, |x| loss(&q, x, &v)));
        assert_close("value", &found[2], &differences(&value, |x| loss(&q, &k, x)));
    }
}

#[test]
fn turning_swaps_rows_and_columns_and_leaves_the_filling() {
    let matrix: Vec<f32> = (0..40).map(|i| i as f32).collect();
    let mut turned = vec![-1.0; 18 * 3];
    turn(&matrix, 20, 18, 2.0, &mut turned, 3);
    for (column, row) in turned.chunks_exact(3).enumerate() {
        let want = [2.0 * column as f32, 2.0 * (20 + column) as f32, -1.0];
        assert_eq!(row.iter().map(|x| x.to_bits()).collect::<Vec<_>>(), want.map(f32::to_bits));
    }
}

#[test]
fn looking_up_is_attention_of_one_query_and_so_is_its_way_back() {
    let (heads, head_width, tokens) = (2, 4, 21);
    let (width, columns) = (heads * head_width, lanes(tokens));
    let places = (0..2 * width * width, 2 * width * width..2 * width * (width + 1));
    let mut key_value = Linear::new(places.0.clone(), places.1.clone());
    key_value.load(&wave(places.1.end, 0.9));
    let (query, slopes) = (wave(width, 0.2), wave(width, 1.7));
    let memory = matrix(width, tokens, 2.2, false);

    // The query as the first of sixteen columns.
    let column = |vector: &[f32]| -> Vec<f32> {
        let first = |x: &f32| [&[*x][..], &[0.0; LANES - 1]].concat();
        vector.iter().flat_map(first).collect()
    };
    let attention = Attention {
        width,
        heads,
        queries: 1,
        query_columns: LANES,
        keys: tokens,
        key_columns: columns,
    };
    let mut keys_values = vec![0.0; 2 * width * columns];
    key_value.apply(&memory, columns, false, &mut keys_values);
    let (keys, values) = keys_values.split_at(width * columns);
    let (mut kept, mut scratch) =
        (Attended::new(heads, 1, columns), AttentionScratch::new(head_width, columns));
    let (wide_query, mut wide_mixed) = (column(&query), vec![0.0; width * LANES]);
    attention.apply([&wide_query, keys, values], &mut kept, &mut scratch, &mut wide_mixed);
    let mut wide_query_slopes = vec![0.0; width * LANES];
    let mut both = vec![0.0; 2 * width * columns];
    let (key_slopes, value_slopes) = both.split_at_mut(width * columns);
    attention.pull(
        [&wide_query, keys, values],
        &wide_mixed,
        &column(&slopes),
        &kept,
        &mut scratch,
        [&mut wide_query_slopes, key_slopes, value_slopes],
    );
    let (mut expected_gradient, mut expected_memory) =
        (vec![0.0; places.1.end], vec![0.0; width * columns]);
    let mut turned = vec![0.0; key_value.scratch_length(tokens)];
    key_value.pull_weight(&memory, &both, columns, tokens, &mut turned, &mut expected_gradient);
    key_value.pull_input(&both, columns, true, &mut expected_memory);

    let lookup = Lookup { width, heads, tokens, columns };
    let mut kept = LookedUp::new(width, heads, columns);
    let mut scratch = LookupScratch::new(width, heads, columns);
    let mut mixed = vec![0.0; width];
    lookup.apply(&query, &memory, &key_value, &mut kept, &mut scratch, &mut mixed);
    let (mut query_slopes, mut memory_slopes) = (vec![0.0; width], vec![0.0; width * columns]);
    let mut gradient = vec![0.0; places.1.end];
    lookup.pull(
        &query,
        &memory,
        &key_value,
        &slopes,
        &kept,
        &mut scratch,
        &mut query_slopes,
        &mut memory_slopes,
        &mut gradient,
    );
    let first =
        |rows: &[f32]| rows.iter().step_by(LANES).map(|&x| f64::from(x)).collect::<Vec<_>>();
    let wide = |numbers: &[f32]| numbers.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
    assert_close("mixed value", &mixed, &first(&wide_mixed));
    assert_close("query", &query_slopes, &first(&wide_query_slopes));
    assert_close("token", &memory_slopes, &wide(&expected_memory));
    assert_close("parameter", &gradient, &wide(&expected_gradient));
}

#[test]
fn a_norm_of_one_token_is_that_of_a_column() {
    let features = 7;
    let mut norm = LayerNorm::new(0..features, features..2 * features);
    norm.load(&wave(2 * features, 0.4));
    let (x, slopes) = (matrix(features, 1, 2.0, true), matrix(features, 1, 3.0, true));
    let (mut kept, mut y) = (Normed::new(features, LANES), vec![0.0; x.len()]);
    norm.apply(&x, LANES, &mut kept, &mut y);
    let (mut x_slopes, mut expected) = (vec![0.0; x.len()], vec![0.0; 2 * features]);
    norm.pull(&kept, &slopes, LANES, &mut x_slopes, &mut expected);

    let first = |rows: &[f32]| rows.iter().step_by(LANES).copied().collect::<Vec<_>>();
    let wide = |numbers: &[f32]| numbers.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
    let (mut kept, mut one) = (NormedOne::new(features), vec![0.0; features]);
    norm.apply_to_one(&first(&x), &mut kept, &mut one);
    assert_close("normalised", &one, &wide(&first(&y)));
    let (mut one, mut gradient) = (vec![0.0; features], vec![0.0; 2 * features]);
    norm.pull_one(&kept, &first(&slopes), &mut one, &mut gradient);
    assert_close("input", &one, &wide(&first(&x_slopes)));
    assert_close("parameter", &gradient, &wide(&expected));
}

#[test]
fn a_layer_on_one_token_is_the_layer_on_a_column() {
    for (inputs, outputs) in [(20, 3), (3, 20), (16, 16)] {
        let length = outputs * inputs + outputs;
        let mut layer = Linear::new(0..outputs * inputs, outputs * inputs..length);
        layer.load(&wave(length, 1.0));
        let (x, slopes) = (matrix(inputs, 1, 2.0, true), matrix(outputs, 1, 3.0, true));
        let (mut y, mut x_slopes) = (vec![0.0; outputs * LANES], vec![0.0; inputs * LANES]);
        layer.apply(&x, LANES, true, &mut y);
        let (mut expected, mut scratch) = (vec![0.0; length], vec![0.0; layer.scratch_length(1)]);
        layer.pull_weight(&x, &slopes, LANES, 1, &mut scratch, &mut expected);
        layer.finish(&mut expected);
        layer.pull_input(&slopes, LANES, false, &mut x_slopes);

        let first = |rows: &[f32]| rows.iter().step_by(LANES).copied().collect::<Vec<_>>();
        let wide = |numbers: &[f32]| numbers.iter().map(|&x| f64::from(x)).collect::<Vec<_>>();
        let mut one = vec![0.0; outputs];
        layer.apply_to_one(0..outputs, &first(&x), true, &mut one);
        assert_close("output", &one, &wide(&first(&y)));
        let (mut one, mut gradient) = (vec![0.0; inputs], vec![0.0; length]);
        layer.pull_one(0..outputs, &first(&x), &first(&slopes), &mut one, &mut gradient);
        layer.finish(&mut gradient);
        assert_close("input", &one, &wide(&first(&x_slopes)));
        assert_close("parameter", &gradient, &wide(&expected));
    }
}
