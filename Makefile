.DEFAULT_GOAL := help
SHELL := /bin/bash
PYTHON ?= $(firstword $(shell command -v python3.11 python3.12 python3.13) python3)
VENV := .venv
BIN := $(VENV)/bin
DOCS_VENV := .venv-docs
export PYTHONUNBUFFERED := 1
# Containers often forbid Python to keep compiled code; each of some hundred processes would compile every library anew.
unexport PYTHONDONTWRITEBYTECODE
STORE ?= sqlite:///mlflow.db
ARTIFACTS ?= mlartifacts
HOST ?= 127.0.0.1

.PHONY: help
help: ## show this help
	@grep -hE '^[a-z-]+:.*##' $(MAKEFILE_LIST) | awk -F ':.*## ' '{printf "  make %-14s %s\n", $$1, $$2}'

$(VENV)/installed: requirements.lock requirements-uv.lock pyproject.toml
	test -x $(BIN)/python || $(PYTHON) -m venv $(VENV)
	$(BIN)/python -m pip install --quiet --require-hashes -r requirements-uv.lock
	$(BIN)/uv pip sync --quiet --require-hashes --python $(BIN)/python requirements.lock requirements-uv.lock \
	  || $(BIN)/python -m pip install --quiet --require-hashes -r requirements.lock
	$(BIN)/uv pip install --quiet --python $(BIN)/python --no-deps --no-build-isolation --editable . 
	touch $@

.PHONY: env
env: $(VENV)/installed ## build the environment from the lock file

.PHONY: hooks
hooks: env ## check style, types and layers before each commit (pre-commit)
	$(BIN)/pre-commit install

.PHONY: repro
repro: env ## run the whole pipeline on the profile in params.yaml (default: 15 minutes on two idle cores)
	$(BIN)/python -m pipeline.stages.processes.dvc_lock
	PATH="$(CURDIR)/$(BIN):$$PATH" python -m pipeline.stages.processes.side_by_side

.PHONY: demo
demo: env ## films of reaching, and an undeclared change found: one page in some four minutes (build/demo/index.html)
	rm -rf build/demo
	TF_CPP_MIN_LOG_LEVEL=3 $(BIN)/python -m pipeline.stages.processes.demo

# As tests/conftest.py, which says why.
COMPILED_QUICKLY := JAX_DISABLE_MOST_OPTIMIZATIONS=1 \
  XLA_FLAGS="--xla_cpu_use_fusion_emitters=false --xla_cpu_parallel_codegen_split_count=1"

# The graph in a folder of its own, with nothing made yet; what was made there before stays.
define copy_graph
mkdir -p $(1)
git ls-files -co --exclude-standard -z -- . ':!artifacts' ':!dvc.lock' | tar --create --null --files-from=- \
  | tar --extract --directory $(1)
git init --quiet $(1)
endef
# As `dvc exp run -S`, which would need commits there: a file, then Hydra's overrides.
OVERRIDE := $(BIN)/python -c 'import sys; from dvc.utils.hydra import apply_overrides as apply; apply(sys.argv[1], sys.argv[2:])'

.PHONY: graph-smoke
graph-smoke: env ## test the whole graph: `dvc repro` on the smoke profile in build/graph_smoke (its figures mean nothing)
	rm -rf build/graph_smoke
	$(call copy_graph,build/graph_smoke)
	$(OVERRIDE) build/graph_smoke/params.yaml profile=smoke 'seeds=[0]' 'icem_variants=[icem]' frames_per_second=2 \
	  '~deployed.icem_double_dagger_mlp_dqdot'
	cd build/graph_smoke \
	  && export JAX_COMPILATION_CACHE_DIR="$${JAX_COMPILATION_CACHE_DIR:-$$PWD/compiled}" \
	  && mkdir -p "$$JAX_COMPILATION_CACHE_DIR" && export NUMBA_CACHE_DIR="$$JAX_COMPILATION_CACHE_DIR" \
	  JAX_PERSISTENT_CACHE_MIN_COMPILE_TIME_SECS=0.2 TF_CPP_MIN_LOG_LEVEL=3 $(COMPILED_QUICKLY) \
	  && PATH="$(CURDIR)/$(BIN):$$PATH" python -m pipeline.stages.processes.side_by_side
	@echo "graph-smoke: the whole graph ran; its page is build/graph_smoke/artifacts/report/index.html"

.PHONY: search
search: env ## search hyper-parameters for all four model kinds, then select (needs the tuples that `make repro` makes)
	$(BIN)/python -m pipeline.stages.search -m model=mlp,kan target=dq,dqdot $(SEARCH)
	$(BIN)/python -m pipeline.stages.select

.PHONY: control-level
control-level: env ## policies from before and after closing the loop, on the changed machine (two hours, after `make repro`)
	PATH="$(CURDIR)/$(BIN):$$PATH" dvc repro experiments/control_level/dvc.yaml

# The paper's four controllers and APG. Models are chosen on all validation windows, as in docs/machines.md.
.PHONY: field
field: env ## controllers on the machine in the field, in build/field; the next report shows their Sim2Real (some half an hour; resumes)
	$(call copy_graph,build/field)
	cp artifacts/all_kinds/params.yaml build/field
	$(OVERRIDE) build/field/params.yaml condition=field +deployed.apg_mlp_dqdot.model=mlp_dqdot \
	  '+deployed.apg_mlp_dqdot.controller="policy=artifacts/apg/mlp_dqdot/seed_0"' \
	  +deployed.apg_mlp_dqdot.from=artifacts/apg/mlp_dqdot/seed_0
	$(OVERRIDE) build/field/conf/profile/default.yaml +identify.evaluation_windows=8320
	cd build/field && PATH="$(CURDIR)/$(BIN):$$PATH" python -m pipeline.stages.processes.side_by_side dvc.yaml sim2sim evaluate_logs
	$(BIN)/python -m pipeline.stages.sim2real_table artifacts=build/field/artifacts output=experiments/paper_tables/field

.PHONY: paper-tables
paper-tables: search ablation field ## make the paper's tables, after `make repro`: a night or more; a killed run goes on where it was
	PATH="$(CURDIR)/$(BIN):$$PATH" python -m pipeline.stages.processes.side_by_side experiments/paper_tables/dvc.yaml

# On a machine that has Python and JAX of its own, and no network:
#   tar xzf build/gpu.tar.gz && PYTHONPATH=gpu:. python3 -m pipeline.stages.ppo profile=paper tracking=none model=… output=…
GPU_PYTHON ?= 3.12
GPU_PACKAGES := antlr4-python3-runtime brax hydra-core jaxkan jaxopt ml-collections mujoco mujoco-mjx omegaconf tensorboardx \
  trimesh

.PHONY: gpu
gpu: env ## pack what a bare machine with its own JAX lacks for training policies (build/gpu.tar.gz; GPU_PYTHON=3.12)
	rm -rf build/gpu && mkdir -p build
	awk '/^[a-z]/{keep = index(" $(GPU_PACKAGES) ", " " substr($$1, 1, index($$1, "==") - 1) " ")} keep' requirements.lock > build/gpu.lock
	$(BIN)/uv pip install --quiet --no-deps --require-hashes --target build/gpu --python-version $(GPU_PYTHON) \
	  --python-platform x86_64-manylinux_2_28 --requirement build/gpu.lock
	tar czf build/gpu.tar.gz -C build gpu

.PHONY: ablation
ablation: env ## train PPO with terms of the reward left out (the paper's appendix; needs the model that `make repro` makes)
	$(BIN)/python -m pipeline.stages.reward_ablation $(ABLATION)

# Two cores: a file's tests share what they made, so they stay on one worker. Each has one thread of BLAS: two would
# wait for those of the other.
PYTEST := OPENBLAS_NUM_THREADS=1 $(BIN)/pytest -n 2 --dist loadfile --no-loadscope-reorder --durations 20
STYLE := $(BIN)/ruff check . && $(BIN)/ruff format --check . && $(BIN)/lint-imports && $(BIN)/mypy
SINCE ?= origin/main

.PHONY: check
check: env ## check style, layers and types, and run the tests beside what changed since a commit (SINCE=origin/main)
	bash -c '$(STYLE)' & $(BIN)/python -m tests.beside $(SINCE); tests=$$?; wait $$! && exit $$tests

.PHONY: test
test: env ## run the tests but the long ones (some 8 minutes on two cores)
	$(PYTEST) -m "not long"

.PHONY: test-all
# Whole searches run as much as they compile.
test-all: export JAX_DISABLE_MOST_OPTIMIZATIONS := 0
test-all: env ## check style, layers and types, and run the long tests: stages, searches, ROS graphs, PostgreSQL, Chromium
	nice -n 5 bash -c '$(STYLE)' & $(PYTEST) -m long; tests=$$?; wait $$! && exit $$tests

.PHONY: coverage
coverage: env ## run all tests and report which lines of the library they run
	$(PYTEST) --cov pipeline --cov-report term:skip-covered

.PHONY: ui
ui: env ## open MLflow on the recorded runs
	@echo "MLflow: http://127.0.0.1:5000 (runs in mlflow.db; Ctrl-C ends it)"
	$(BIN)/mlflow ui --backend-store-uri sqlite:///mlflow.db --host 127.0.0.1 --port 5000

.PHONY: server
server: env ## start a tracking server that machines share (STORE=postgresql+psycopg://USER@HOST/DATABASE ARTIFACTS=FOLDER)
	$(BIN)/mlflow server --backend-store-uri $(STORE) --artifacts-destination $(ARTIFACTS) --host $(HOST) --port 5000

$(DOCS_VENV)/installed: requirements-docs.lock
	test -x $(DOCS_VENV)/bin/python || $(PYTHON) -m venv $(DOCS_VENV)
	$(DOCS_VENV)/bin/python -m pip install --quiet --require-hashes -r requirements-docs.lock
	touch $@

.PHONY: docs
docs: $(DOCS_VENV)/installed ## build the pages and the API reference into build/docs (open build/docs/index.html)
	NO_MKDOCS_2_WARNING=1 $(DOCS_VENV)/bin/mkdocs build --quiet --strict

.PHONY: lock
lock: ## resolve the dependencies of pyproject.toml anew into the lock files
	$(BIN)/uv pip compile --quiet --upgrade --universal --generate-hashes --no-emit-index-url --no-annotate --no-header \
	  --python-version 3.11 --group test pyproject.toml -o requirements.lock
	$(BIN)/uv pip compile --quiet --upgrade --generate-hashes --no-emit-index-url --no-annotate --no-header \
	  --python-version 3.11 --group benchmark -o requirements-benchmark.lock
	$(BIN)/uv pip compile --quiet --upgrade --universal --generate-hashes --no-emit-index-url --no-annotate --no-header \
	  --python-version 3.11 --group docs -o requirements-docs.lock
	echo uv | $(BIN)/uv pip compile --quiet --upgrade --universal --generate-hashes --no-emit-index-url --no-annotate \
	  --no-header --python-version 3.11 - -o requirements-uv.lock
