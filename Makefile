# Each target sets up .venv by itself; all that is needed beforehand is one of these Pythons. The first
# that can make an environment: a name may be a shim without an interpreter behind it.
PYTHONS = python3.11 python3.12 python3.13
PYTHON ?= $(shell for name in $(PYTHONS); do $$name -c 'import ensurepip, venv' 2>/dev/null && echo $$name && break; done)
OUT ?= out/study
CAMPAIGN ?= $(wildcard out/campaign out/machining-worlds)
# A folder of recordings of your own; without it, those that `wrenchsight data` lists.
DATA ?=
JOBS ?= 2
COUNT ?= 5000
SEED ?= 1000000
STUDY_OPTIONS = $(if $(DATA),--data $(DATA)) $(if $(QUICK),--quick) $(if $(FRESH),--fresh)

BIN := .venv/bin
INSTALL := $(BIN)/python -m pip install --quiet --constraint constraints.txt

# A file's tests stay together, as they share what is made for them; tests/conftest.py orders the files.
SIDE_BY_SIDE = -n $(JOBS) --dist loadfile --no-loadscope-reorder

# The arithmetic of another processor, on this one: numba's kernels, BLAS, numpy's, libm's and torch's
# functions without the instructions that processors have since 2006 or so. Each differs in last bits.
OTHER_PROCESSOR = NUMBA_CPU_NAME=generic NUMBA_CPU_FEATURES= NUMBA_CACHE_DIR=$(CURDIR)/out/numba-generic \
  OPENBLAS_CORETYPE=Prescott NPY_DISABLE_CPU_FEATURES="X86_V3 X86_V4 AVX512_ICL AVX512_SPR" \
  GLIBC_TUNABLES=glibc.cpu.hwcaps=-AVX,-AVX2,-FMA,-FMA4,-AVX512F \
  ATEN_CPU_CAPABILITY=default MKL_CBWR=COMPATIBLE ONEDNN_MAX_CPU_ISA=SSE41

.PHONY: demo study test test-long test-all test-generic lint fuzz kills arms package-arms bench docs readme readme-worlds release-check clean
.DELETE_ON_ERROR:

demo: .venv/.ready
	$(BIN)/wrenchsight demo

study: .venv/.ready
	$(BIN)/wrenchsight study --out $(OUT) --jobs $(JOBS) $(STUDY_OPTIONS)

test: .venv/.ready-test
	$(BIN)/python -m pytest $(SIDE_BY_SIDE) -m "not long and not slow"

# Those that take more than seconds: kernels of their own, whole commands, streams, real recordings.
test-long: .venv/.ready-test
	$(BIN)/python -m pytest $(SIDE_BY_SIDE) -m "long and not slow"

# All, those among them that take minutes: whole experiments, long searches.
test-all: .venv/.ready-test
	$(BIN)/python -m pytest $(SIDE_BY_SIDE)

# The same tests, as another processor computes them.
test-generic: .venv/.ready-test
	$(OTHER_PROCESSOR) $(BIN)/python -m pytest $(SIDE_BY_SIDE)

lint: .venv/.ready-lint
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

# Spoilt inputs of seeds that nobody has seen, and doubles of any bits in every estimator: COUNT, SEED.
fuzz: .venv/.ready-test
	PYTHONPATH=tests/fuzz:tests/sample_models $(BIN)/python -m fuzzing --count $(COUNT) --seed $(SEED) --keep out/fuzz
	PYTHONPATH=tests/fuzz:tests/sample_models $(BIN)/python -m fuzzing.random_samples --seed $(SEED)

# Commands that are ended at random moments.
kills: .venv/.ready-test
	PYTHONPATH=tests/fuzz:tests/sample_models $(BIN)/python -m fuzzing.kills --seed $(SEED)

# Arms from URDF to `estimate`, into docs/arms.md; goes on where it was stopped.
arms: .venv/.ready-test
	@mkdir -p out/arms
	PYTHONPATH=tests/arms:tests/meshes $(BIN)/python -m arm_table --work out/arms --page docs/arms.md

# Arms of other packages, in PACKAGES as `package_arms` says, into a section of the same page.
package-arms: .venv/.ready-test
	@test -n "$(PACKAGES)" || { echo "name the folder of the unpacked packages: make package-arms PACKAGES=..."; exit 2; }
	PYTHONPATH=tests/arms $(BIN)/python -m package_arms --packages $(PACKAGES)

bench: .venv/.ready-test
	@set -e; for file in tests/benchmarks/bench_*.py; do echo "== $$file"; PYTHONPATH=tests/sample_models $(BIN)/python $$file; done

# Runs the tutorial, too: a minute, and some more where its kernels are not compiled yet.
docs: .venv/.ready-docs
	$(BIN)/python -m mkdocs build --strict
	@echo "out/docs/index.html"

readme: .venv/.ready
	$(BIN)/python -m wrenchsight.analyses.study.readme_table $(OUT) README.md $(CAMPAIGN)

# The same with the figures of campaigns alone.
readme-worlds: .venv/.ready
	$(BIN)/python -m wrenchsight.analyses.study.readme_table --campaign README.md $(CAMPAIGN)

# Wheel and sdist, each in an empty environment of PYTHON; needs a package index, and minutes.
release-check: .venv/.ready-test
	$(BIN)/python tests/wrenchsight/release_check.py --work out/release --python $(PYTHON)

clean:
	rm -rf .venv out .mypy_cache .ruff_cache .hypothesis
	find . -name __pycache__ -type d -prune -exec rm -rf {} +

.venv/bin/python:
	@test -n "$(PYTHON)" || { echo "none of $(PYTHONS) makes an environment: install one (on Debian and Ubuntu with its -venv package), or name it: make PYTHON=/path/to/python3.12 ..."; exit 2; }
	@echo "Taking $(PYTHON): $$($(PYTHON) --version)"
	@$(PYTHON) -m venv .venv

.venv/.ready: pyproject.toml constraints.txt | .venv/bin/python
	@echo "Setting up .venv (drake, torch and others: some minutes the first time) ..."
	$(INSTALL) --editable .
	@touch $@

.venv/.ready-test: .venv/.ready
	$(INSTALL) --editable '.[test]'
	@touch $@

.venv/.ready-lint: .venv/.ready
	$(INSTALL) --editable '.[test,lint]'
	@touch $@

.venv/.ready-docs: .venv/.ready
	$(INSTALL) --editable '.[docs]'
	@touch $@
