# catnav: `make demo` shows it, `make test` tests it. Everything lands in build/.
BUILD := $(CURDIR)/build
JOBS  := $(shell nproc 2>/dev/null || echo 2)
BIN   := $(BUILD)/devel/lib/catnav/catnav
DEMO  := $(BUILD)/demo
CTEST := cd $(BUILD) && ROS_HOSTNAME=localhost ctest -V -j$(JOBS)

.PHONY: build packages packages-dev demo test test-reference test-insertions test-oracle study fuzz asan tsan alloc coverage lint doc clean

# catkin leaves paths that do not exist yet out of the test environment: a fresh tree is configured twice
build: packages
	@test -e $(BUILD)/.configured || cmake -S . -B $(BUILD) -DPYTHON_EXECUTABLE=/usr/bin/python3
	@env -u MAKELEVEL -u MAKEFLAGS cmake --build $(BUILD) -j$(JOBS)
	@test -e $(BUILD)/.configured || { cmake $(BUILD) && env -u MAKELEVEL -u MAKEFLAGS cmake --build $(BUILD) -j$(JOBS) && \
	    touch $(BUILD)/.configured; }

# Installs what packages.txt lists and this machine lacks; with everything present it touches nothing
packages:
	@sh scripts/install_packages.sh packages.txt

demo: build
	@sh scripts/demo.sh $(BIN) $(DEMO)

test: build
	@$(CTEST) > $(BUILD)/test.log 2>&1; sh $(CURDIR)/scripts/test_summary.sh $(BUILD)/test.log

# CATNAV_REFERENCE=DIR and CATNAV_DATA=DIR: the accuracy and geometry tests on other folders
test-reference: build
	@$(CTEST) -L reference > $(BUILD)/test.log 2>&1; sh $(CURDIR)/scripts/test_summary.sh $(BUILD)/test.log

# Random insertions judged by the oracle: COUNT of them (10000) drawn from SEED (1), from number FIRST (0) on;
# scenes of failures stay in build/insertions
test-insertions: build
	@CATNAV_ORACLE=$(BUILD)/test/oracle /usr/bin/python3 test/command/insertions.py $(BIN) \
	    --count $(or $(COUNT),10000) --seed $(or $(SEED),1) --first $(or $(FIRST),0) --keep $(BUILD)/insertions

# Whole runs judged by the oracle on every step: real vessels, and STEPS (100) of each of IPC's hard cases; CATNAV_DATA
# has the bunny and the dolphin. Hours
test-oracle: build
	@CATNAV_ORACLE=$(BUILD)/test/oracle CATNAV_LONG=1 /usr/bin/python3 test/command/test_vessels.py $(BIN)
	@CATNAV_ORACLE=$(BUILD)/test/oracle CATNAV_HARD=$(or $(STEPS),100) /usr/bin/python3 test/command/test_hard.py $(BIN)

# Accuracy, stability and speed of every model into build/study/index.md: about half an hour
study: build
	$(BIN) study $(BUILD)/study

# What follows is for those who change catnav, with the packages of packages-dev.txt.
packages-dev:
	@sh scripts/install_packages.sh packages-dev.txt

# Every fuzzer of file readers and message handlers, SECONDS each (clang); the goal is SECONDS=600. KEEP=test/fuzz/corpus
# packs what it found worth keeping. Then all that was found once more without sanitizers: no input takes a second.
SECONDS := 60
fuzz: packages-dev build
	sh scripts/fuzz.sh $(SECONDS) $(BUILD)/fuzz $(KEEP)
	sh scripts/replay.sh $(BUILD) 1 $(BUILD)/fuzz

# All tests in C and all rostests under the address, undefined-behaviour and leak sanitizers
asan: build
	sh scripts/sanitize.sh address $(BUILD)

# Threaded tests and 64 clients of the node for SECONDS under the thread sanitizer
tsan: build
	sh scripts/sanitize.sh thread $(BUILD) $(SECONDS)

# Every allocation of the node failing in turn, not one in 61
alloc: build
	CATNAV_EVERY_ALLOCATION=1 $(BUILD)/test/test_node

# Lines and branches of the core that its tests reach, a line a file; fails below 95 % and 85 %
coverage: packages
	@cmake -S . -B $(BUILD)/coverage -DCATNAV_CORE_ONLY=ON -DCMAKE_C_FLAGS="--coverage -fprofile-update=atomic" > /dev/null
	@find $(BUILD)/coverage -name '*.gcda' -delete
	@cmake --build $(BUILD)/coverage -j$(JOBS) > $(BUILD)/coverage/build.log && cd $(BUILD)/coverage && \
	    ctest -j$(JOBS) > test.log; /usr/bin/python3 $(CURDIR)/scripts/coverage.py $(BUILD)/coverage $(CURDIR)

# clang-tidy, cppcheck and catkin_lint -W2 --strict have nothing to say
lint: packages-dev build
	@cmake $(BUILD) -DCMAKE_EXPORT_COMPILE_COMMANDS=ON > /dev/null
	@sh scripts/lint.sh $(BUILD)

# The C headers as HTML into build/doc
doc: packages-dev
	@mkdir -p $(BUILD)/doc && (cat cmake/Doxyfile; echo "OUTPUT_DIRECTORY = $(BUILD)/doc") | doxygen - && echo $(BUILD)/doc/html/index.html

clean:
	rm -rf $(BUILD)
