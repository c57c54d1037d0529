// /sentence: the readings of a sentence, and the plan for them, which is played.

let askCount = 0; // identifies the latest question
const plan = new StepView(byId("plan"), "A scene of the plan");

byId("ask").addEventListener("submit", (event) => {
  event.preventDefault();
  const current = (askCount += 1);
  attempt(async () => {
    if (event.submitter?.value) event.target.sentence.value = event.submitter.value; // an example
    const { sentence, appearance, target } = Object.fromEntries(new FormData(event.target));
    const answer = await request("POST", "/api/sentence", { sentence, appearance, target: target === "true" }, () => current === askCount);
    byId("answer").hidden = false;
    byId("answer-title").textContent = answer.understood ? `“${sentence}” will be ${target} with a probability of ${percent(answer.success_probability)}` : "Nothing was understood";
    byId("readings-title").textContent = answer.understood ? `Readings; ✓ has the target value, ${target}, in the last scene` : "";
    byId("notes").replaceChildren(...answer.notes.map((note) => element("p", { class: "notice" }, note)));
    byId("readings").replaceChildren(...answer.readings.map((reading) => bar(programCode(reading.program), reading.probability, reading.satisfied, true)));
    plan.show(answer.start, answer.steps);
    byId("answer-title").focus();
    plan.play();
  }, byId("ask"));
});
