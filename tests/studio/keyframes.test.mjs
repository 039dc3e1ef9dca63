// Unit tests of keyframes.js, run by test_keyframes.py with node.
import assert from "node:assert/strict";
import { test } from "node:test";
import { alongLine, framesOf, gapClass, gapsOf, keysOf, moved, rangeText, textOf, toggled, withKeys } from "../../stages/studio/assets/keyframes.js";

const ASKED = { keyframes: "0,15,40", parts: [{ part: "arms", frames: "20-22" }], keep: [], pins: [], path: null, locks: [] };

test("frames are read from every form of text, and written again", () => {
  assert.deepEqual(framesOf("40, 0,15", 41), [0, 15, 40]);
  assert.deepEqual(framesOf("10-12,3", 41), [3, 10, 11, 12]);
  assert.deepEqual(framesOf("all", 3), [0, 1, 2]);
  assert.deepEqual(framesOf("every:15", 41), [0, 15, 30, 40]);
  assert.deepEqual(framesOf("7,99", 41), [7]);
  assert.deepEqual(framesOf(null, 41), []);
  assert.equal(textOf([40, 0, 0, 15]), "0,15,40");
  assert.equal(textOf([]), null);
  for (const keys of [[0], [0, 1, 2], [3, 9, 40]]) assert.deepEqual(framesOf(textOf(keys), 41), keys);
});

test("keys of one row change, and those of others stay", () => {
  assert.deepEqual(keysOf(ASKED, "", 41), [0, 15, 40]);
  assert.deepEqual(keysOf(ASKED, "arms", 41), [20, 21, 22]);
  const changed = withKeys(ASKED, "", [0, 40]);
  assert.equal(changed.keyframes, "0,40");
  assert.deepEqual(changed.parts, ASKED.parts);
  assert.deepEqual(withKeys(ASKED, "arms", []).parts, []);
  assert.deepEqual(withKeys(ASKED, "spine", [5]).parts, [...ASKED.parts, { part: "spine", frames: "5" }]);
  assert.equal(ASKED.keyframes, "0,15,40");
});

test("a key that is set twice is gone; one that is moved replaces what is there", () => {
  assert.deepEqual(toggled(toggled([0, 9], 5), 5), [0, 9]);
  assert.deepEqual(toggled([0, 9], 5), [0, 5, 9]);
  assert.deepEqual(moved([0, 5, 9], 5, 9, 41), [0, 9]);
  assert.deepEqual(moved([0, 5, 9], 9, 99, 41), [0, 5, 40]);
  assert.deepEqual(moved([0, 5, 9], 0, -3, 41), [0, 5, 9]);
});

test("gaps lie between keys and are as long as the time from key to key", () => {
  assert.deepEqual(gapsOf([0, 1, 31], 30), [{ first: 2, last: 30, seconds: 1 }]);
  assert.deepEqual([0.5, 1, 2].map(gapClass), ["short", "medium", "long"]);
  assert.equal(rangeText([3, 3]), "3");
  assert.equal(rangeText([3, 9]), "3-9");
});

test("a path goes through a drawn line in equal steps", () => {
  const { frames, places } = alongLine([[0, 0], [1, 0], [1, 3]], 10, 14);
  assert.deepEqual(frames, [10, 11, 12, 13, 14]);
  assert.deepEqual(places, [[0, 0], [1, 0], [1, 1], [1, 2], [1, 3]]);
  assert.deepEqual(alongLine([[2, 2], [2, 2]], 4, 5).places, [[2, 2], [2, 2]]);
});
