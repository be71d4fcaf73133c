"""Plans positions of LiDARs. `plan.py` has the steps in order; each step has its file.

- request: what is asked (with areas and goals), of which `site` and `detectability` of the detector
- candidates: poses, and LiDARs within the budget (`costs`)
- observe: what each pose and LiDAR sees; race: those that may be the best in more frames
- choose: `choice` of the best sets, their `front` for other budgets, `predict` in other traffic
- check: the best are simulated in full (`simulate`); `verdict` says what decides
- answer: `sensitivity`, `tables`, and the words in `answer` and `notes`
"""
