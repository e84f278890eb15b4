# Completes `ledgerline` in bash: verbs and options as the programs themselves know them, else files.
_ledgerline() {
  local program=${COMP_WORDS[0]/#\~/$HOME}
  mapfile -t COMPREPLY < <("$program" __complete "${COMP_WORDS[@]:1:COMP_CWORD}" 2>/dev/null)
}
complete -o default -F _ledgerline ledgerline
