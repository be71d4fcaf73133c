"""Plans positions of LiDARs. `plan.py` has the steps in order; each step has its file.

- request: requirements, areas and goals; `site`: the scene; `detectability`: that of the detector
- candidates: poses, and LiDARs within the budget (`costs`)
- observe: points of each pose and LiDAR on objects; race: more frames for the pairs that are best
- choose: `choice` of the best sets, `front` for other budgets, `predict` in other traffic
- check: the best options are simulated in full (`simulate`); `verdict`: is the request met?
- answer: `sensitivity`, `tables`, and the words in `answer` and `notes`

An option is a set of units. A unit is one LiDAR at one pose.
"""
