#include "common/fabric/tx/envelope.hpp"

#include "common/fabric/tx/form.hpp"

namespace ledgerline::fabric {

void OpenedTransaction::seal_result() {
  response.set_extension(result.SerializeAsString());
  action.mutable_action()->set_proposal_response_payload(response.SerializeAsString());
}

std::string OpenedTransaction::bytes() {
  seal_result();
  transaction.mutable_actions(0)->set_payload(action.SerializeAsString());
  payload.set_data(transaction.SerializeAsString());
  envelope.set_payload(payload.SerializeAsString());
  return envelope.SerializeAsString();
}

Result<OpenedTransaction> open_transaction(std::string_view bytes) {
  OpenedTransaction out;
  if (!parse(out.envelope, bytes) || !out.payload.ParseFromString(out.envelope.payload()) ||
      !out.transaction.ParseFromString(out.payload.data()) || out.transaction.actions_size() != 1 ||
      !out.action.ParseFromString(out.transaction.actions(0).payload()) ||
      !out.response.ParseFromString(out.action.action().proposal_response_payload()) ||
      !out.result.ParseFromString(out.response.extension())) {
    return Error{"it is no transaction of one action"};
  }
  return out;
}

}  // namespace ledgerline::fabric
