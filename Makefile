# Two commands: `make demo` lights up the embedded dark scene, `make test` checks all.
PYTHON ?= python3
BIN := .venv/bin
LOCK := requirements.lock
READY := .venv/.ready
EXTRAS := video,raw,heif,metrics,enhance2d,view,export,cluster,dev
INSTALL := $(BIN)/python -m pip install --quiet --editable '.[$(EXTRAS)]'
PYTEST := -m pytest --numprocesses=auto --maxprocesses=4 --dist=loadfile

.PHONY: install demo test test-lowest test-newest lint lock clean

install: $(READY)

# The versions that the tests passed with; where these do not install (another Python,
# another machine), the newest that pyproject.toml allows.
$(READY): pyproject.toml requirements.lock
	@$(PYTHON) -c 'import sys; sys.exit(sys.version_info < (3, 11))' || \
	  { echo "error: $(PYTHON) is older than 3.11; use make PYTHON=/path/to/python3.11"; exit 2; }
	$(PYTHON) -m venv .venv
	$(BIN)/python -m pip install --quiet --upgrade pip
	$(INSTALL) --constraint $(LOCK) || { \
	  echo "the versions of $(LOCK) do not install here: the newest instead"; $(INSTALL); }
	@touch $(READY)

demo: install
	$(BIN)/python demo.py

test: install lint
	$(BIN)/python $(PYTEST)

# The tests with the lowest and the newest versions that pyproject.toml allows, in an
# environment of their own.
test-lowest: RESOLUTION := lowest-direct
test-newest: RESOLUTION := highest
test-lowest test-newest:
	$(PYTHON) -m venv --clear .venv-other
	.venv-other/bin/python -m pip install --quiet uv
	.venv-other/bin/uv pip install --quiet --python .venv-other \
	  --resolution $(RESOLUTION) --editable '.[$(EXTRAS)]'
	.venv-other/bin/python $(PYTEST)

lint: install
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/lint-imports --no-cache --no-logo
	$(BIN)/pyright

# Renews the lock: the newest versions that pyproject.toml allows.
lock:
	rm -rf .venv
	$(MAKE) install LOCK=/dev/null
	$(BIN)/python -m pip freeze --exclude-editable >requirements.lock

clean:
	rm -rf .venv .venv-other outputs scenes
