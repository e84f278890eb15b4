#include "chaincode/endorser/shell/settings.hpp"

namespace ledgerline::endorser {
namespace {

int check_one_in(Config& config, const std::string& table, int otherwise) {
  return static_cast<int>(config.integer(
      {table + "check_one_in",
       "one of so many proposals, at random, is asked of the peer as well; a different answer ends the endorser"},
      otherwise, 1, 1'000'000));
}

std::string client_ca(Config& config, const std::string& table) {
  return config.text(
      {table + "tls_client_ca", "PEM file of the authorities of its clients' certificates; none: they need none"}, "");
}

std::string checkpoint(Config& config, const std::string& table) {
  return config.text({table + "checkpoint",
                      "file of what it knows of the chain, written every ten minutes and at the end, so that a start "
                      "reads newer blocks alone. Mode 0600: its writer decides what is endorsed",
                      "none: all blocks are read"},
                     "");
}

FirstStateSettings first_state(Config& config, const std::string& table) {
  FirstStateSettings out;
  out.folder = config.text(
      {table + "first_state",
       "folder of a Fabric peer's snapshot (`peer snapshot submitrequest`), where a start without a checkpoint begins; "
       "the values of its keys are [the peer's word](fabric.md#an-organisations-own-endorser)",
       "none: all blocks are read"},
      "");
  out.hash = config.text(
      {table + "first_state_hash",
       "`snapshot_hash` of that block at another organisation's peer: a snapshot with another one is refused",
       "none: it is trusted"},
      "");
  return out;
}

}  // namespace

Settings read_settings(Config& config) {
  Settings out;
  out.serve.listen = config.text({"serve.listen", "ADDRESS:PORT; port 0: any free one"}, "127.0.0.1:0");
  out.serve.tls_certificate = config.text({"serve.tls_certificate", "PEM file"});
  out.serve.tls_key = config.text({"serve.tls_key", "PEM file of its key"});
  out.serve.tls_client_ca = client_ca(config, "serve.");
  out.check_one_in = check_one_in(config, "serve.", out.check_one_in);
  out.first_state = first_state(config, "start.");
  out.checkpoint = checkpoint(config, "output.");
  out.summary = config.text({"output.summary", "JSON file, written at the end", "none"}, "");
  return out;
}

Settings read_own_endorser_settings(Config& config) {
  Settings out;
  out.msp_dir = config.text({"own_endorser.msp_dir",
                             "folder of an OU=peer identity: this process endorses for its organisation, and asks "
                             "others only where it cannot; an intruder gets that key ([what it "
                             "costs](fabric.md#an-organisations-own-endorser)). Needs config_block and [[orderer]]",
                             "none: others endorse"},
                            "");
  out.check_one_in = check_one_in(config, "own_endorser.", out.check_one_in);
  out.checkpoint = checkpoint(config, "own_endorser.");
  out.first_state = first_state(config, "own_endorser.");
  out.serve.listen = config.text(
      {"own_endorser.listen",
       "ADDRESS:PORT that serves other programs, too, as `ledgerline endorser` does; with tls_certificate and tls_key",
       "none: this process alone"},
      "");
  out.serve.tls_certificate = config.text({"own_endorser.tls_certificate", "PEM file, of that server"}, "");
  out.serve.tls_key = config.text({"own_endorser.tls_key", "PEM file of its key"}, "");
  out.serve.tls_client_ca = client_ca(config, "own_endorser.");
  out.summary = config.text({"own_endorser.summary", "JSON file of what it did, written at the end", "none"}, "");
  return out;
}

}  // namespace ledgerline::endorser
