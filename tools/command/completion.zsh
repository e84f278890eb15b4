#compdef ledgerline
# Completes `ledgerline` in zsh: verbs and options as the programs themselves know them, else files.
_ledgerline() {
  local -a found
  found=(${(f)"$(${~words[1]} __complete "${(@)words[2,CURRENT]}" 2>/dev/null)"})
  if (( $#found )); then compadd -a found; else _files; fi
}
# Loaded from fpath, this file is the function; sourced, it has to be registered.
if [[ $funcstack[1] == _ledgerline ]]; then _ledgerline "$@"; else compdef _ledgerline ledgerline; fi
