# make install          .venv with everything pinned; two to five minutes
# make train            the main job: 18 minutes on two cores after the installation
# make train BUDGET=paper    the paper's 1.2 million steps
# make lint             what is checked without running the code
# make quick            lint and the fast tests: what a change is tried with
# make test             lint and all tests: what CI runs

PYTHON ?= $(shell command -v python3.11 || command -v python3)
BUDGET ?= default
CORES := $(shell nproc 2> /dev/null || echo 2)
BIN := .venv/bin
PIP := $(BIN)/pip install --quiet --disable-pip-version-check
TORCH_INDEX ?= https://download.pytorch.org/whl/cpu
# A worker takes whole files, so that what a file sets up is set up once.
PYTEST := $(BIN)/python -m pytest --numprocesses $(CORES) --dist loadfile

.PHONY: install train lint quick test clean

install: .venv/.installed

train: .venv/.installed
	$(BIN)/freemesh train --config train_$(BUDGET).yaml --resume

lint: .venv/.installed
	$(BIN)/ruff check .
	$(BIN)/ruff format --check .
	$(BIN)/mypy
	$(BIN)/lint-imports

quick: lint
	$(PYTEST) -m "not slow"

test: lint
	$(PYTEST)

# torch first, from PyTorch's index of builds without CUDA; every other package comes from the index that pip is set to.
.venv/.installed: requirements.lock requirements-dev.lock pyproject.toml
	@$(PYTHON) -c 'import sys; sys.exit(not (3, 11) <= sys.version_info < (3, 14) and "freemesh-ray needs Python 3.11 to 3.13: make PYTHON=python3.11")'
	$(PYTHON) -m venv .venv
	sed -n '/^torch==/,/[^\\]$$/p' requirements.lock > .venv/torch.lock
	$(PIP) --no-deps --require-hashes --retries 2 --extra-index-url $(TORCH_INDEX) --requirement .venv/torch.lock
	$(PIP) --require-hashes --requirement requirements.lock --requirement requirements-dev.lock
	$(PIP) --no-deps --no-build-isolation --editable .
	$(BIN)/freemesh compile
	touch $@

clean:
	rm -rf .venv .pytest_cache .ruff_cache .mypy_cache .hypothesis .import_linter_cache
