// Grid cell of a position, used both to sort means and to search them, so that rounding agrees. Cells at
// the border extend to infinity.
fn cell_in(position: vec3<f32>, lo: vec3<f32>, per_unit: f32, dims: vec3<i32>) -> vec3<i32> {
    let last = vec3<f32>(dims - vec3<i32>(1));
    return vec3<i32>(clamp((position - lo) * per_unit, vec3<f32>(0.0), last));
}
