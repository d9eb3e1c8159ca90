"""The error falls as effects are added

An arm hides something that its folder does not tell. `diagnose` adds one physical effect after the other, and
keeps one only if poses that no fit has seen are predicted better with it.
"""

import calib
from inspector import figures

dataset = calib.load_dataset("sample_data/hidden_effect_b")
found = calib.diagnose(dataset)
print(found.to_frame().to_string(index=False))

# %%
# Two effects were found. The dashed line is what the declared noise alone leaves; below it no model can come.

figure = figures.error_history(found)
figure.update_layout(title_text="RMS error of training and test poses after each effect that was added")
figure.show()

# %%
# Each step was chosen by a ranking of all effects of the catalogue. The lead over the next has to be more
# than 3.

print(found.screenings[0].to_frame()[["effect", "log_evidence"]].head().to_string(index=False))
