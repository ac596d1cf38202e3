"""
A method of your own
====================

Enter a method of your own, and see it judged beside the project's: here subtraction of a master
whose dark tones are brightened.

A method takes a master in 0..1 and a scene, and returns the light to project. `enter` asks the laws
and, with `quick=False`, nine judges, on inputs that no setting of the project was chosen on
(`pip install 'domesim[metrics]'`; most of an hour, or name a few: ``only=["golf"]``).

``python docs/examples/own_method.py`` runs it.
"""

import matplotlib.pyplot as plt
import numpy as np

from compensate import compensate
from domesim.light import Light
from domesim.scene import Scene
from validation.entry import enter


def brightened(master: Light, scene: Scene) -> Light:
    """Subtraction of a master with a gamma of 0.6."""
    return compensate(master**0.6, scene, method="subtractive").light


entered = enter("brightened", brightened, quick=True)
print(entered)

# %%
# Laws that are broken, of each way.
figure, axis = plt.subplots(figsize=(5, 3), layout="constrained")
for shift, table in enumerate(entered.tables):
    ways, broken = zip(*((row[0], float(str(row[2]))) for row in table.rows), strict=True)
    kind = table.caption.split()[1].rstrip(":")
    axis.barh(np.arange(len(ways)) + 0.4 * shift, broken, 0.4, label=kind)
axis.set(yticks=range(len(ways)), yticklabels=ways, xlabel="laws broken")
axis.legend()
plt.show()
