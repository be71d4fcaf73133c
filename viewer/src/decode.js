/** What pyinfra/viewer/encoding.py packed: the columns of one frame's points. */

/** Columns as typed arrays of length count; time and object are null where the data has none. */
export async function unpackPoints(packed) {
  const bytes = await inflate(packed.data);
  const n = packed.count;
  let start = 0;
  const column = () => bytes.subarray(start, (start += n));
  const words = () => {
    const low = column(), high = column();
    return Uint16Array.from(low, (value, i) => value | (high[i] << 8));
  };
  const steps = [words(), words(), words()];
  return {
    count: n,
    xyz: positions(steps, packed),
    intensity: column(),
    time: packed.time ? column() : null,
    object: packed.objects ? words() : null, // index into packed.objects
    objects: packed.objects,
  };
}

/** World coordinates (3 n) in metres; a step is the difference to the point before. */
function positions(steps, { origin, step_m: step, count }) {
  const xyz = new Float32Array(3 * count);
  const at = new Uint16Array(3); // wraps around as the writer's differences do
  for (let i = 0; i < count; i++) {
    for (let axis = 0; axis < 3; axis++) {
      at[axis] += steps[axis][i];
      xyz[3 * i + axis] = origin[axis] + step * at[axis];
    }
  }
  return xyz;
}

async function inflate(base64) {
  const bytes = Uint8Array.from(atob(base64), (letter) => letter.charCodeAt(0));
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("deflate"));
  return new Uint8Array(await new Response(stream).arrayBuffer());
}
