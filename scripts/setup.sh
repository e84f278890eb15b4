# Sourced by ./fly and ./run-tests: what both do before anything runs.
# shellcheck shell=bash

say() { printf '\033[1m%s\033[0m\n' "$*" >&2; }
die() { printf 'ledgerline: %s\n' "$*" >&2; exit 1; }

probe_fails() {  # probe_fails cmd:NAME|file:PATTERN|py:MODULE
  case $1 in
    cmd:*) ! command -v "${1#cmd:}" >/dev/null ;;
    file:*) ! compgen -G "${1#file:}" >/dev/null ;;
    py:*) ! python3 -c "import ${1#py:}" 2>/dev/null ;;
    *) die "scripts/packages.txt: unknown probe $1" ;;
  esac
}

# install_packages GROUP...: installs the Debian packages whose probe fails; sudo where not root; a list where neither works.
install_packages() {
  local group probe package missing=()
  while read -r group probe package; do
    case " $* " in *" $group "*) ;; *) continue ;; esac
    if probe_fails "$probe"; then missing+=("$package"); fi
  done < <(grep -v '^#' "$root/scripts/packages.txt")
  [ ${#missing[@]} -eq 0 ] && return 0

  local as_root=()
  if [ "$(id -u)" -ne 0 ]; then
    if command -v sudo >/dev/null && { sudo -n true 2>/dev/null || [ -t 0 ]; }; then
      as_root=(sudo)
    else
      die "these Debian packages are missing and neither root nor sudo is at hand. Ask an administrator for:
  apt-get install ${missing[*]}"
    fi
  fi
  command -v apt-get >/dev/null || die "these packages are missing and this is no Debian (no apt-get): ${missing[*]}"
  say "Installing ${#missing[@]} Debian packages"
  local log="$root/build/install.log"
  mkdir -p "$root/build"
  if ! { "${as_root[@]}" apt-get update -qq &&
         "${as_root[@]}" env DEBIAN_FRONTEND=noninteractive apt-get install -y -qq --no-install-recommends "${missing[@]}"; } >"$log" 2>&1; then
    tail -n 15 "$log" >&2
    die "the installation failed (whole log: $log). Missing: ${missing[*]}"
  fi
}

version_at_least() { [ "$(printf '%s\n%s\n' "$1" "$2" | sort -V | head -n 1)" = "$1" ]; }  # version_at_least WANTED IS

check_tools() {
  local is
  is=$(cmake --version | sed -n '1s/[^0-9]*//p')
  version_at_least 3.25 "$is" || die "cmake is $is, 3.25 or newer is needed (Debian 12 has it: apt-get install cmake)"
  is=$(g++ -dumpfullversion)
  version_at_least 12.0 "$is" || die "g++ is $is, 12 or newer is needed (Debian 12 has it: apt-get install g++)"
  is=$(python3 -c 'import platform; print(platform.python_version())')
  version_at_least 3.9 "$is" || die "python3 is $is, 3.9 or newer is needed"
}

tree_version() { sed -n 's/^project(ledgerline VERSION \([0-9.]*\).*/\1/p' "$root/CMakeLists.txt"; }
# Unix time of the commit, so that the same tree gives the same packages; without git, of the changelog.
tree_time() { git -C "$root" log -1 --format=%ct 2>/dev/null || stat -c %Y "$root/CHANGELOG.md"; }

make_venv() {  # make_venv DIRECTORY REQUIREMENTS: a Python venv of pinned requirements, recreated when they change
  if cmp -s "$2" "$1/requirements.txt"; then return 0; fi
  rm -rf "$1"
  python3 -m venv "$1" || die "cannot make a Python venv (apt-get install python3-venv)"
  "$1/bin/pip" install --quiet --disable-pip-version-check --no-deps --require-hashes -r "$2" || die "pip install failed"
  cp "$2" "$1/requirements.txt"
}

npm_packages() {  # npm_packages FROM TO: what FROM/package-lock.json names, again when that changes
  cmp -s "$1/package-lock.json" "$2/package-lock.json" && return
  mkdir -p "$2"
  cp "$1/package.json" "$1/package-lock.json" "$2/"
  (cd "$2" && npm ci --no-audit --no-fund --loglevel=error) || { rm "$2/package-lock.json"; die "npm ci failed"; }
}

page_libraries() {  # what the ground station's page is built with; a page without them can do all but its 3-D view and charts
  local from="$root/ground/page/lib" to="$root/build/npm-station"
  cmp -s "$from/package-lock.json" "$to/package-lock.json" && return
  (install_packages page && npm_packages "$from" "$to") ||
    say "the page is built without its 3-D view and charts; with npm (apt-get install npm) the next build has them"
}

# build PRESET TARGET...: configures where needed and builds, with a bar on a terminal.
build() {
  local preset=$1 dir="$root/build/$1" log="$root/build/$1.log"
  shift
  mkdir -p "$root/build"
  if [ ! -f "$dir/build.ninja" ]; then
    (cd "$root" && cmake --preset "$preset") >"$log" 2>&1 || { tail -n 30 "$log" >&2; die "cmake failed (whole log: $log)"; }
  fi
  local bar=0
  [ -t 2 ] && bar=1
  if ! NINJA_STATUS='@%f %t ' ninja -C "$dir" "$@" 2>&1 | tee "$log" | awk -v bar=$bar -v what="Building $preset" '
    /^@[0-9]+ [0-9]+ / {
      split(substr($0, 2), n, " "); percent = int(100 * n[1] / n[2])
      if (bar) {
        filled = int(percent * 40 / 100); line = ""
        for (i = 0; i < 40; i++) line = line (i < filled ? "#" : ".")
        printf "\r%s [%s] %3d %%  %d of %d ", what, line, percent, n[1], n[2] > "/dev/stderr"
      } else if (percent >= next_percent && n[2] > 5) {
        printf "%s: %d %% (%d of %d)\n", what, percent, n[1], n[2] > "/dev/stderr"
        next_percent = percent + 20
      }
    }
    END { if (bar) printf "\r\033[K" > "/dev/stderr" }'; then
    sed -nE '/FAILED|error:/,+15p' "$log" | sed -n 1,60p >&2
    die "the build failed (whole log: $log)"
  fi
}

# bare_debian SUITE FOLDER LOG PACKAGE...: a root of Debian, of packages from where this machine has its own; kept until PACKAGE...
# change. Needs root and mmdebstrap.
bare_debian() {
  local suite=$1 folder=$2 log=$3 mirror file options=()
  shift 3
  [ "$*" = "$(cat "$folder/packages" 2>/dev/null)" ] && return
  say "Making a root of Debian ($suite)"
  rm -rf "$folder"
  mkdir -p "$(dirname "$folder")"
  mirror=$(apt-get indextargets --format '$(REPO_URI)' 'Created-By: Packages' | grep -v security | sort -u | sed -n 1p)
  for file in /etc/apt/apt.conf.d/*; do
    grep -qs 'Acquire::' "$file" && ! grep -qs 'Post-Invoke\|gzip' "$file" && options+=(--aptopt="$file")
  done
  mmdebstrap --variant=apt "${options[@]}" --include="$(IFS=,; echo "$*")" "$suite" "$folder" "$mirror" >"$log" 2>&1 ||
    { tail -n 15 "$log" >&2; die "mmdebstrap failed (whole log: $log)"; }
  echo "$*" >"$folder/packages"
}
