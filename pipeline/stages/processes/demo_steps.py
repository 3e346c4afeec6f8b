"""What `make demo` does: the stages' own commands, small enough for some five minutes on two cores."""

from pathlib import Path

FOLDER = Path("build/demo")
EFFECT_SEED = 21  # of the change's kind, joint and size; chosen so that a model can be corrected by it
STEPS = (
    (
        "Record twelve minutes of the machine as it is",
        f"record profile=smoke 'record.session_minutes=[6,6]' output={FOLDER}/old",
    ),
    (
        "Change the machine, seal what changed, and record eight minutes",
        "record_changed profile=smoke 'record_changed.session_minutes=[4,4]' 'effects=[drawn]' "
        f"effects_seed={EFFECT_SEED} recorded={FOLDER}/old/sessions output={FOLDER}/new",
    ),
    (
        "Turn the bags into tuples, and check their quality",
        f"ingest profile=smoke logs={FOLDER}/old/sessions output={FOLDER}/tuples report={FOLDER}/quality",
    ),
    (
        "Learn a model of the machine's motion",
        f"identify profile=smoke tuples={FOLDER}/tuples output={FOLDER}/model checkpoints=null "
        "'identify.selected.mlp_dqdot={hidden:[64,64],learning_rate:4.0e-3,maximum_epochs:20}'",
    ),
    (
        "Reach targets by planning on the model",
        f"evaluate_icem profile=default model={FOLDER}/model variant=icem icem.first_episodes=4 episodes.steps=200 "
        f"episodes.table_rows=4096 icem.chunk_episodes=4 checkpoints=null output={FOLDER}/reaching",
    ),
    (
        "Close the loop: what do the new logs show that the model lacks?",
        f"close_loop profile=smoke nominal={FOLDER}/old/sessions measured={FOLDER}/new/sessions "
        f"model={FOLDER}/model output={FOLDER}/loop "
        "'identify.selected.nfir_dqdot={maximum_epochs:48,ensemble:{members:2,hidden:[32,32]}}'",
    ),
    (
        "Open the seal",
        f"unseal closed_loop={FOLDER}/loop/closed_loop.json measured={FOLDER}/new/sessions "
        f"seal={FOLDER}/new/undeclared.seal output={FOLDER}/loop/judgement.json",
    ),
)
