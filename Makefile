# `make demo` is the first command, `make test` the second. PYTHON chooses the interpreter.
PYTHON ?= python3
VENV ?= .venv
BIN = $(VENV)/bin
PACKAGES = schemas twin devkit conductor viewer hpc drivetwin

.PHONY: help install install-test install-test-all install-train install-bench demo driving test test-all test-rest audit-env faults redteam fuzz soak offline planted mutation check dist licences lock models integer-models console console-pictures site film processors ablation frozen clean

help:
	@echo "make demo     install, then run the eight-case demo campaign (again: resume)"
	@echo "make test     install what the quick tests need, then run them: some minutes"
	@echo "make test-all that, then processes, faults, clusters, browsers, torch (one to three hours)"
	@echo "make driving  100 km of free driving on a GPU: PART=1 to 10, COMMIT= the one that froze the stack"
	@echo "make install  create $(VENV) with the pinned dependencies"
	@echo "make audit-env  $(VENV)-audit with the packages that a certificate lists, by their hashes: CERT=demo.cert"
	@echo "make faults   the table of docs/reliability.md: a thousand faults on real processes (root)"
	@echo "make redteam  the table of attacks of docs/security.md, on real processes with two users (root)"
	@echo "make fuzz     half an hour of coverage-guided fuzzing; findings become seeds of the tests"
	@echo "make soak     20,000 short cases; what grows is printed (a quarter of an hour, or more)"
	@echo "make offline  bundle and container image, built and used without a network (minutes)"
	@echo "make install-bench  install the peers of 'conductor bench' and 'twin bench'"
	@echo "make models   render the dataset, train the shipped detectors anew (-j4: all at once; DEVICE=cuda:0)"
	@echo "make integer-models  render pictures, make the shipped detectors whole numbers again (some minutes)"
	@echo "make console  build the console's page from viewer/console/page (Node, npm)"
	@echo "make console-pictures  docs/images/console-*.webp from a recorded run: RUN=runs/recorded (Chromium)"
	@echo "make site     the documentation as plain files in build/site (half a minute); search works without a server"
	@echo "make film     the README's film: the scenarios that ship, as the ego sees them (some minutes)"
	@echo "make processors  bytes of everything with AVX-512 and without, on a CPU that has it (half an hour)"
	@echo "make planted  plants bugs one by one and runs the tests that must notice (half an hour)"
	@echo "make mutation  small changes of the pure cores that no test notices (a quarter of an hour)"
	@echo "make ablation  what each sensor brings, per weather: runs aeb-ablation, writes docs/ablation.md (some minutes, or a GPU)"
	@echo "make frozen   the fusion stack on 256 cases of streets drawn from this commit (ARGS='--workers cuda'; QUICK=1: 8)"
	@echo "make dist     wheels, sdist, SHA-256 and the list of components of a release, in dist"
	@echo "make licences  writes docs/licences.md: the licences of all that an installation brings"
	@echo "make check    format, lint, types, layers, shape of the code and licences, in under a minute"

# What commands of the README need; others: make install EXTRAS=scenarios,search,export,ros2.
EXTRAS ?= scenarios,search
install: $(VENV)/.installed

# Extras that are asked for by name are installed into an environment that is there, too.
ifeq ($(origin EXTRAS),command line)
.PHONY: $(VENV)/.installed
endif

$(BIN)/python3:
	@$(PYTHON) -c 'import sys; v = sys.version_info[:2]; sys.exit(None if (3, 11) <= v < (3, 14) else "Python 3.11, 3.12 or 3.13 is needed, this is %d.%d; use e.g. make PYTHON=python3.12" % v)'
	$(PYTHON) -m venv $(VENV)

$(VENV)/.installed: pyproject.toml constraints.txt | $(BIN)/python3
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[$(EXTRAS)]'
	@touch $@

install-test: $(VENV)/.installed-test

# All that `make install` installs, too.
$(VENV)/.installed-test: pyproject.toml constraints.txt | $(BIN)/python3
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[test,check,docs,export,gltf,scenarios,search]'
	@touch $(VENV)/.installed $@

install-test-all: $(VENV)/.installed-test install-train

install-bench: install
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[bench]'

install-train: $(VENV)/.installed-train

$(VENV)/.installed-train: $(VENV)/.installed
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[train]'
	@touch $@

# Exit code 1 says that a case did not pass; that is what the demo is meant to find.
demo: install
	@$(BIN)/conductor run aeb-demo; code=$$?; [ $$code -le 1 ] || exit $$code

# Goes on where it was stopped; every part that was made counts (docs/driving.md).
PART ?= 1
COMMIT ?= $(shell git log -1 --format=%H -- devkit/fusion ':!devkit/fusion/tuning' devkit/reference devkit/lane devkit/models)
driving: install-test
	$(BIN)/twin driving --part $(PART) --commit $(COMMIT) --out runs/driving
	@cd runs/driving/part-$$(printf %02d $(PART)) && \
	  $(abspath $(BIN))/conductor run campaign.yaml --out run $(or $(ARGS),--workers 8xcuda); \
	  code=$$?; [ $$code -le 1 ] || exit $$code
	$(BIN)/conductor driving runs/driving --markdown runs/driving/results.md

# No torch, browser or scheduler; one real run of every command.
# Many tests wait for processes and sockets: half of the cores more than there are keep them busy.
TESTERS = $(shell expr $$(nproc) + $$(nproc) / 2 + 1)

test: install-test
	$(BIN)/pytest $(if $(ARGS),$(ARGS),--lane quick --numprocesses $(TESTERS) --dist loadgroup)

# Every test once.
test-all: test test-rest

# What the quick lane leaves out, or the files of one of N parts of it: TURN=K/N.
test-rest: install-test-all
	$(BIN)/pytest $(if $(ARGS),$(ARGS),--lane rest --part $(or $(TURN),0/1) --numprocesses auto --dist loadgroup)

# An environment with what a certificate lists, and this project: make audit-env CERT=aeb-demo.cert
audit-env: install
	mkdir -p build
	$(BIN)/conductor audit $(CERT) --lock $(ARGS) > build/lock.txt
	$(PYTHON) -m venv --clear $(VENV)-audit
	$(VENV)-audit/bin/pip install --quiet --disable-pip-version-check --no-deps --require-hashes --requirement build/lock.txt
	$(VENV)-audit/bin/pip install --quiet --disable-pip-version-check --no-deps --editable .

# More than a thousand faults; goes on where it was stopped. The tests inject each once.
faults: install-test
	$(BIN)/python tests/faults/run.py --out build/faults --page docs/reliability.md $(ARGS)

# Goes on where it was stopped. ARGS="--only 6 --minutes 1" tries one row.
redteam: install-test
	$(BIN)/python tests/redteam/run.py --out build/redteam --page docs/security.md $(ARGS)

fuzz: install-test
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[fuzz]'
	PYTHONPATH=tests $(BIN)/python tests/fuzz/nightly.py --minutes $(or $(MINUTES),30)

soak: install-test
	$(BIN)/python tests/soak.py --cases 20000

# Half a gigabyte of wheels and two images, several minutes; `make test-all` leaves it out.
offline: install-test
	OFFLINE=1 PATH="$$(dirname $$(tests/e2e/install_apptainer.sh build/apptainer)):$$PATH" \
	  $(BIN)/pytest tests/e2e/test_offline.py tests/e2e/test_containers.py $(ARGS)

# Goes on where it was stopped. `make test` checks only that every entry still fits the code.
planted: install-test
	$(BIN)/python tests/planted/run.py $(ARGS)

mutation: install-test
	$(BIN)/pip install --quiet --disable-pip-version-check --constraint constraints.txt --editable '.[mutation]'
	$(BIN)/python tests/mutation/run.py $(ARGS)

check: install-test
	$(BIN)/ruff format --check .
	$(BIN)/ruff check .
	$(BIN)/mypy
	$(BIN)/lint-imports --no-cache
	$(BIN)/python tests/house/shape.py
	$(BIN)/python tests/house/prose.py
	$(BIN)/typos README.md ARCHITECTURE.md CHANGELOG.md docs $(PACKAGES)
	PYTHONPATH=tests $(BIN)/python -m release.licences

# The same tree gives the same bytes; times in the archives are those of SOURCE_DATE_EPOCH, if it is set.
dist: install-test
	PYTHONPATH=tests $(BIN)/python -m release.build --out dist

licences: install-test
	PYTHONPATH=tests $(BIN)/python -m release.licences --write

# Writes constraints.txt anew from the newest versions that pyproject.toml admits.
lock:
	$(PYTHON) -m venv $(VENV)-lock
	$(VENV)-lock/bin/pip install --quiet --disable-pip-version-check --editable '.[test,check,docs,train,export,gltf,scenarios,search,bench,mutation,release]'
	$(VENV)-lock/bin/pip freeze --exclude-editable | grep -v '^drivetwin' > constraints.txt
	rm -rf $(VENV)-lock

# The detectors in devkit/models; about a quarter of an hour on one GPU, goes on where it was stopped.
DEVICE ?= cuda:0
MODELS = yolov2-w25 yolov2-tiny-w25 yolov3-w25 yolov3-tiny-w25
models: $(MODELS:%=build/models/%)
	for model in $(MODELS); do \
	  cp build/models/$$model/$$model.onnx devkit/models/ && \
	  cp build/models/$$model/MODEL.md devkit/models/$$model.md || exit; \
	done

.PHONY: build/models/data $(MODELS:%=build/models/%)
$(MODELS:%=build/models/%): build/models/%: build/models/data
	$(BIN)/devkit train build/models/data --model $* --out $@ --size $(SIZE) --epochs $(EPOCHS) --half \
	  --validate-every 20 --threads 4 --device $(DEVICE)
build/models/%: SIZE = 320x192
build/models/%: EPOCHS = 80
build/models/yolov2-tiny-w25: SIZE = 640x384
build/models/yolov2-tiny-w25: EPOCHS = 42
build/models/yolov3-w25: EPOCHS = 34

build/models/data: install-train
	$(BIN)/twin dataset $@ --count 20000 --size 640x360 --streets 12,4,2 --split-shares 0.75,0.2,0.05 \
	  --rule long_side_px_min=24 --rule short_side_px_min=8 --rule visible_px_min=150 \
	  --device $(DEVICE) $(DATASET)

# The same pictures give the same files.
integer-models: install
	$(BIN)/twin dataset build/models/calibration --count 160 --seed 71 --size 640x360 --streets 6,1,1 \
	  --split-shares 0.8,0.1,0.1
	for model in $(MODELS); do \
	  $(BIN)/devkit quantize $$model -o devkit/models/$$model-int8.integer \
	    --calibrate build/models/calibration || exit; \
	done

# Goes on behind the parts that are complete, while nothing was changed. ARGS="--share 1 --parts vehicle": more, or less.
processors: install-test
	PYTHONPATH=tests $(BIN)/python tests/device/processor_check.py --out build/processors --share 0.02 $(ARGS)

# Goes on where it was stopped. On a GPU ARGS="--workers cuda"; a small one on a laptop: ARGS="--weather clear,heavy_fog".
ABLATION = runs/aeb-ablation
ablation: install
	@$(BIN)/conductor run aeb-ablation --out $(ABLATION) $(ARGS); code=$$?; [ $$code -le 1 ] || exit $$code
	$(BIN)/python -m devkit.fusion.ablation $(ABLATION) --page docs/ablation.md

# Streets come from the name of the commit, which has to hold all that is run. The draw is listed before anything runs.
FROZEN_COMMIT = $(shell git rev-parse HEAD)
frozen: install
	@git diff --quiet HEAD -- schemas twin devkit conductor ':!devkit/fusion/tuning/draws.yaml' \
	  || { echo "make frozen: commit your changes first; the streets are drawn from the commit" >&2; exit 2; }
	@file=$$($(BIN)/python -m devkit.fusion.frozen --commit $(FROZEN_COMMIT) --out build/frozen/$(FROZEN_COMMIT) $(if $(QUICK),--quick)) \
	  && $(BIN)/conductor run $$file --out runs/frozen-$(FROZEN_COMMIT)$(if $(QUICK),-quick) $(ARGS)

# The console's page: sources in viewer/console/page, built files in viewer/console/built. Node and npm are needed.
console:
	cd viewer/console/page && npm ci --no-audit --no-fund --ignore-scripts && npm run types && npm run build

# Pictures of the console in docs/images; RUN was recorded (--view record), and a case of it failed. Chromium is needed.
console-pictures: install-test
	PYTHONPATH=tests $(BIN)/python tests/console_pictures.py $(RUN) docs/images

# Readable from disk; nothing on it asks another machine for anything.
site: install-test
	$(BIN)/python docs/site/build.py $(ARGS)

# Pictures of every scenario over time, put together as one animated WebP below a megabyte.
film: install
	$(BIN)/python docs/site/film.py --out docs/images/scenarios.webp $(ARGS)

clean:
	rm -rf $(VENV) $(VENV)-lock build dist
