// Fabric's official client behind lines of JSON: requests on standard input, each with an id, answers on standard output
// as they come. Many at once; each as the identity that it names.
'use strict';
const crypto = require('node:crypto');
const fs = require('node:fs');
const readline = require('node:readline');
const grpc = require('@grpc/grpc-js');
const { connect, hash, signers, checkpointers } = require('@hyperledger/fabric-gateway');
const { Timestamp } = require('google-protobuf/google/protobuf/timestamp_pb.js');
const { common, gateway: gatewayProtos, ledger, msp, orderer, peer } = require('@hyperledger/fabric-protos');

const [gatewayEndpoint, gatewayCa, ordererEndpoint, ordererCa, channelName, contractName] = process.argv.slice(2);
const timeout = 20_000; // ms; nothing on a quiet machine takes a tenth of it
const dial = (endpoint, ca) => new grpc.Client(endpoint, grpc.credentials.createSsl(fs.readFileSync(ca)));
const rpc = dial(gatewayEndpoint, gatewayCa);
const ordererRpc = dial(ordererEndpoint, ordererCa);
const within = () => ({ deadline: Date.now() + timeout });
const base64 = (bytes) => Buffer.from(bytes ?? []).toString('base64');
const bytesOf = (text) => Buffer.from(text, 'base64');

// The other signature of the same message: s in the upper half of the order of P-256.
function withHighS(der) {
  const order = 0xffffffff00000000ffffffffffffffffbce6faada7179e84f3b9cac2fc632551n;
  const rEnd = 4 + der[3];
  const s = BigInt(`0x${Buffer.from(der.subarray(rEnd + 2)).toString('hex')}`);
  let high = (order - s).toString(16).padStart(64, '0');
  if (high[0] >= '8') high = `00${high}`;
  const integer = Buffer.from(high, 'hex');
  const content = Buffer.concat([der.subarray(2, rEnd), Buffer.from([2, integer.length]), integer]);
  return Buffer.concat([Buffer.from([0x30, content.length]), content]);
}

const sessions = new Map();
function sessionOf(identity) {
  const name = JSON.stringify(identity);
  if (!sessions.has(name)) {
    const credentials = Buffer.from(identity.certificate);
    const right = signers.newPrivateKeySigner(crypto.createPrivateKey(identity.key));
    const sign = identity.highS ? async (digest) => withHighS(await right(digest)) : right;
    const serialized = new msp.SerializedIdentity();
    serialized.setMspid(identity.mspId);
    serialized.setIdBytes(credentials);
    sessions.set(name, {
      sign,
      serialized: serialized.serializeBinary(),
      gateway: connect({
        client: rpc, identity: { mspId: identity.mspId, credentials }, signer: sign,
        evaluateOptions: within, endorseOptions: within, submitOptions: within, commitStatusOptions: within,
      }),
    });
  }
  return sessions.get(name);
}
const networkOf = (request) => request.session.gateway.getNetwork(request.channel ?? channelName);
const contractOf = (request) => networkOf(request).getContract(request.contract ?? contractName);
const proposalOf = (request, call) =>
  contractOf(request).newProposal(call.fn, { arguments: call.args.map(bytesOf) });
async function statusOf(submitted) {
  const status = await submitted.getStatus();
  return { tx: status.transactionId, code: status.code, block: Number(status.blockNumber), successful: status.successful };
}

async function take(stream, count, each) {
  const found = [];
  const timer = setTimeout(() => stream.close(), timeout);
  try {
    if (count === 0) return found;
    for await (const item of stream) {
      found.push(await each(item));
      if (found.length === count) break;
    }
  } finally {
    clearTimeout(timer);
    stream.close();
  }
  return found;
}

const plainEvent = (event) => ({
  name: event.eventName, payload: base64(event.payload), block: Number(event.blockNumber), tx: event.transactionId,
});

function plainBlock(block) {
  return {
    number: block.getHeader().getNumber(),
    previous: base64(block.getHeader().getPreviousHash_asU8()),
    dataHash: base64(block.getHeader().getDataHash_asU8()),
    data: block.getData().getDataList_asU8().map(base64),
    flags: [...block.getMetadata().getMetadataList_asU8()[2]],
  };
}

const plainFiltered = (block) => ({
  number: block.getNumber(), channel: block.getChannelId(),
  transactions: block.getFilteredTransactionsList().map((tx) => ({
    tx: tx.getTxid(), code: tx.getTxValidationCode(),
    events: (tx.getTransactionActions()?.getChaincodeActionsList() ?? [])
      .map((action) => [action.getChaincodeEvent().getEventName(), base64(action.getChaincodeEvent().getPayload_asU8())]),
  })),
});

function changeHeader(payload, change) {
  const header = common.ChannelHeader.deserializeBinary(payload.getHeader().getChannelHeader_asU8());
  change(header);
  payload.getHeader().setChannelHeader(header.serializeBinary());
}

function peerPolicy(mspId) {
  const role = new msp.MSPRole();
  role.setMspIdentifier(mspId);
  role.setRole(msp.MSPRole.MSPRoleType.PEER);
  const principal = new msp.MSPPrincipal();
  principal.setPrincipalClassification(msp.MSPPrincipal.Classification.ROLE);
  principal.setPrincipal(role.serializeBinary());
  const signed = new common.SignaturePolicy();
  signed.setSignedBy(0);
  const one = new common.SignaturePolicy.NOutOf();
  one.setN(1);
  one.addRules(signed);
  const rule = new common.SignaturePolicy();
  rule.setNOutOf(one);
  const policy = new common.SignaturePolicyEnvelope();
  policy.setRule(rule);
  policy.addIdentities(principal);
  return policy.serializeBinary();
}

// An endorsed transaction with something in it changed; it is signed afterwards by who made it.
const forgeries = {
  result({ endorsed, response, action }) {
    action.getResponse().setPayload(Buffer.from('forged'));
    response.setExtension$(action.serializeBinary());
    endorsed.setProposalResponsePayload(response.serializeBinary());
  },
  input({ actionPayload }) {
    const input = peer.ChaincodeProposalPayload.deserializeBinary(actionPayload.getChaincodeProposalPayload_asU8());
    input.setInput(Buffer.concat([input.getInput_asU8(), Buffer.from([0x7a, 0])]));
    actionPayload.setChaincodeProposalPayload(input.serializeBinary());
  },
  unendorsed({ endorsed }) { endorsed.setEndorsementsList([]); },
  // Whatever somebody wants written, endorsed by whose keys he has: as if there were no contract.
  async writes({ endorsed, response, action, request }) {
    const set = new ledger.rwset.kvrwset.KVRWSet();
    for (const one of request.writes) {
      const write = new ledger.rwset.kvrwset.KVWrite();
      write.setKey(one.key);
      if (one.delete) write.setIsDelete(true);
      else write.setValue(bytesOf(one.value));
      set.addWrites(write);
    }
    for (const one of request.policies ?? []) {
      const write = new ledger.rwset.kvrwset.KVMetadataWrite();
      write.setKey(one.key);
      if (one.mspId) {
        const entry = new ledger.rwset.kvrwset.KVMetadataEntry();
        entry.setName('VALIDATION_PARAMETER');
        entry.setValue(peerPolicy(one.mspId));
        write.addEntries(entry);
      }
      set.addMetadataWrites(write);
    }
    const results = ledger.rwset.TxReadWriteSet.deserializeBinary(action.getResults_asU8());
    const own = results.getNsRwsetList().find((part) => part.getNamespace() === contractName);
    own.setRwset(set.serializeBinary());
    action.setResults(results.serializeBinary());
    response.setExtension$(action.serializeBinary());
    endorsed.setProposalResponsePayload(response.serializeBinary());
    endorsed.setEndorsementsList(await Promise.all(request.peers.map(async (identity) => {
      const one = sessionOf(identity);
      const endorsement = new peer.Endorsement();
      endorsement.setEndorser(one.serialized);
      endorsement.setSignature(await one.sign(
        hash.sha256(Buffer.concat([endorsed.getProposalResponsePayload_asU8(), one.serialized]))));
      return endorsement;
    })));
  },
  async endorsedByItself({ endorsed, session }) {
    const endorsement = new peer.Endorsement();
    endorsement.setEndorser(session.serialized);
    endorsement.setSignature(await session.sign(
      hash.sha256(Buffer.concat([endorsed.getProposalResponsePayload_asU8(), session.serialized]))));
    endorsed.setEndorsementsList([endorsement]);
  },
  twoActions({ transaction }) { transaction.setActionsList([0, 0].map(() => transaction.getActionsList()[0])); },
  transactionId({ payload, request }) { changeHeader(payload, (header) => header.setTxId(request.txId)); },
  nothing() {},
  signature() {},
  channel({ payload }) { changeHeader(payload, (header) => header.setChannelId('nowhere')); },
  headerType({ payload, request }) { changeHeader(payload, (header) => header.setType(request.type)); },
  // A field that nobody knows, so that the orderer counts so many bytes, or a few less: a signature has up to 72.
  size({ payload, request }) {
    const wanted = request.bytes - 72 - payload.serializeBinary().length - 5;
    const length = Buffer.from([0, 7, 14, 21].map((shift, i) => ((wanted >> shift) & 0x7f) | (i < 3 ? 0x80 : 0)));
    return Buffer.concat([payload.serializeBinary(), Buffer.from([0x7a]), length, Buffer.alloc(wanted)]);
  },
};
function partsOf(prepared) {
  const envelope = prepared.getEnvelope();
  const payload = common.Payload.deserializeBinary(envelope.getPayload_asU8());
  const transaction = peer.Transaction.deserializeBinary(payload.getData_asU8());
  const actionPayload = peer.ChaincodeActionPayload.deserializeBinary(transaction.getActionsList()[0].getPayload_asU8());
  const endorsed = actionPayload.getAction();
  const response = peer.ProposalResponsePayload.deserializeBinary(endorsed.getProposalResponsePayload_asU8());
  const action = peer.ChaincodeAction.deserializeBinary(response.getExtension_asU8());
  return { envelope, payload, transaction, actionPayload, endorsed, response, action };
}
async function forge(request, endorsedTransaction) {
  const prepared = gatewayProtos.PreparedTransaction.deserializeBinary(endorsedTransaction.getBytes());
  const parts = partsOf(prepared);
  const { envelope, payload, transaction, actionPayload } = parts;
  const bytes = await forgeries[request.how]({ ...parts, request, session: request.session });
  transaction.getActionsList()[0].setPayload(actionPayload.serializeBinary());
  payload.setData(transaction.serializeBinary());
  envelope.setPayload(bytes ?? payload.serializeBinary());
  const { gateway } = request.session;
  return request.how === 'signature' ? gateway.newSignedTransaction(prepared.serializeBinary(), Buffer.from('none'))
    : gateway.newTransaction(prepared.serializeBinary());
}

const toBuffer = (message) => Buffer.from(message.serializeBinary());
const unary = (method, message, Response, ms = timeout) => new Promise((resolve, reject) => {
  rpc.makeUnaryRequest(method, toBuffer, Response.deserializeBinary, message, { deadline: Date.now() + ms },
    (error, answer) => (error ? reject(error) : resolve(answer)));
});

// To the orderer itself: what it acknowledges.
async function broadcast(session, transaction) {
  const envelope = gatewayProtos.PreparedTransaction.deserializeBinary(transaction.getBytes()).getEnvelope();
  if (!envelope.getSignature_asU8().length) envelope.setSignature(await session.sign(transaction.getDigest()));
  const stream = ordererRpc.makeBidiStreamRequest(
    '/orderer.AtomicBroadcast/Broadcast', toBuffer, orderer.BroadcastResponse.deserializeBinary, within());
  return new Promise((resolve, reject) => {
    stream.on('error', reject);
    stream.on('end', () => resolve({}));
    stream.on('data', (response) => {
      resolve({ status: response.getStatus(), info: response.getInfo() });
      stream.end();
    });
    stream.write(envelope);
  });
}

const deliverServices = {
  peer: [() => rpc, '/protos.Deliver/Deliver', peer.DeliverResponse],
  filtered: [() => rpc, '/protos.Deliver/DeliverFiltered', peer.DeliverResponse],
  private: [() => rpc, '/protos.Deliver/DeliverWithPrivateData', peer.DeliverResponse],
  orderer: [() => ordererRpc, '/orderer.AtomicBroadcast/Deliver', orderer.DeliverResponse],
};
function position(where) {
  const result = new orderer.SeekPosition();
  if (where === 'newest') result.setNewest(new orderer.SeekNewest());
  if (where === 'oldest') result.setOldest(new orderer.SeekOldest());
  if (typeof where === 'number') {
    const specified = new orderer.SeekSpecified();
    specified.setNumber(where);
    result.setSpecified(specified);
  }
  return result;
}
async function seekEnvelope(request) {
  const channelHeader = new common.ChannelHeader();
  channelHeader.setType(common.HeaderType.DELIVER_SEEK_INFO);
  channelHeader.setChannelId(request.channel ?? channelName);
  channelHeader.setTimestamp(Timestamp.fromDate(new Date(Date.now() - 1000 * (request.ageS ?? 0))));
  const signatureHeader = new common.SignatureHeader();
  signatureHeader.setCreator(request.session.serialized);
  signatureHeader.setNonce(crypto.randomBytes(24));
  const header = new common.Header();
  header.setChannelHeader(channelHeader.serializeBinary());
  header.setSignatureHeader(signatureHeader.serializeBinary());
  const seek = new orderer.SeekInfo();
  if (request.start !== null) seek.setStart(position(request.start));
  if (request.stop !== null) seek.setStop(position(request.stop));
  if (request.orFail) seek.setBehavior(orderer.SeekInfo.SeekBehavior.FAIL_IF_NOT_READY);
  const payload = new common.Payload();
  payload.setHeader(header);
  payload.setData(seek.serializeBinary());
  const envelope = new common.Envelope();
  envelope.setPayload(payload.serializeBinary());
  envelope.setSignature(await request.session.sign(hash.sha256(payload.serializeBinary())));
  return envelope;
}

const operations = {
  async submit(request) {
    const commit = await contractOf(request).submitAsync(request.fn, { arguments: request.args.map(bytesOf) });
    return { result: base64(commit.getResult()), ...await statusOf(commit) };
  },
  async evaluate(request) {
    return { result: base64(await proposalOf(request, request).evaluate()) };
  },
  async endorse(request) {
    const transaction = await proposalOf(request, request).endorse();
    return { result: base64(transaction.getResult()), tx: transaction.getTransactionId() };
  },
  async endorsers(request) {
    const transaction = await proposalOf(request, request).endorse();
    const { endorsed } = partsOf(gatewayProtos.PreparedTransaction.deserializeBinary(transaction.getBytes()));
    const mspIds = endorsed.getEndorsementsList()
      .map((one) => msp.SerializedIdentity.deserializeBinary(one.getEndorser_asU8()).getMspid());
    return { endorsers: mspIds };
  },
  // Endorses all calls, one after the other, before any is submitted: they have read the same state. Then submits them
  // all at once.
  async together(request) {
    const endorsed = [];
    for (const call of request.calls) {
      const transaction = await proposalOf(request, call).endorse();
      endorsed.push(call.how ? await forge({ ...request, ...call }, transaction) : transaction);
    }
    return { all: await Promise.all(endorsed.map(async (transaction) => statusOf(await transaction.submit()))) };
  },
  // A transaction that is submitted when its signer's time is over.
  async slow(request) {
    const transaction = await proposalOf(request, request).endorse();
    await new Promise((resolve) => { setTimeout(resolve, request.until - Date.now()); });
    return statusOf(await transaction.submit());
  },
  // Submits a transaction that was endorsed before another one was committed.
  async late(request) {
    const transaction = await proposalOf(request, request).endorse();
    await statusOf(await (await proposalOf(request, request.between).endorse()).submit());
    return statusOf(await transaction.submit());
  },
  // A transaction whose id somebody else has used before, in one of his own.
  async stolen(request) {
    const proposal = proposalOf(request, request);
    const thief = { ...request, session: sessionOf(request.thief), how: 'transactionId', txId: proposal.getTransactionId() };
    await (await forge(thief, await proposalOf(thief, request.theft).endorse())).submit();
    // Behind it in the order of blocks.
    await statusOf(await (await proposalOf(request, request).endorse()).submit());
    return statusOf(await (await proposal.endorse()).submit());
  },
  async replay(request) {
    const proposal = proposalOf(request, request);
    const transaction = await proposal.endorse();
    const first = await statusOf(await transaction.submit());
    const again = {};
    for (const how of ['endorse', 'evaluate']) {
      again[how] = await proposal[how]().then(() => ({}), plainError);
    }
    const second = await statusOf(await transaction.submit());
    return { first, ...again, second };
  },
  async forged(request) {
    const transaction = await forge(request, await proposalOf(request, request).endorse());
    if (request.broadcast) return broadcast(request.session, transaction);
    const submitted = await transaction.submit();
    return request.without_status ? { tx: transaction.getTransactionId() } : statusOf(submitted);
  },
  // The peer's own service, without its gateway.
  async propose(request) {
    const proposed = gatewayProtos.ProposedTransaction.deserializeBinary(proposalOf(request, request).getBytes());
    const proposal = proposed.getProposal();
    proposal.setSignature(await request.session.sign(hash.sha256(proposal.getProposalBytes_asU8())));
    const response = await unary('/protos.Endorser/ProcessProposal', proposal, peer.ProposalResponse);
    return {
      status: response.getResponse().getStatus(), message: response.getResponse().getMessage(),
      result: base64(response.getResponse().getPayload_asU8()), endorsed: response.hasEndorsement(),
    };
  },
  async status(request) {
    const message = new gatewayProtos.CommitStatusRequest();
    message.setTransactionId(request.tx);
    message.setChannelId(request.channel ?? channelName);
    message.setIdentity(request.session.serialized);
    const signed = new gatewayProtos.SignedCommitStatusRequest();
    signed.setRequest(message.serializeBinary());
    signed.setSignature(await request.session.sign(hash.sha256(signed.getRequest_asU8())));
    const answer = await unary('/gateway.Gateway/CommitStatus', signed, gatewayProtos.CommitStatusResponse, request.ms);
    return { code: answer.getResult(), block: answer.getBlockNumber() };
  },
  async events(request) {
    const options = {};
    if (request.start !== undefined) options.startBlock = BigInt(request.start);
    // A checkpoint that knows no block, only the transaction behind which it goes on.
    if (request.after) {
      options.checkpoint = { getBlockNumber: () => undefined, getTransactionId: () => request.after };
    }
    const stream = await networkOf(request).getChaincodeEvents(request.contract ?? contractName, options);
    return { events: await take(stream, request.count, plainEvent) };
  },
  // Reads in parts, each part a new stream that goes on where the checkpoint says; the checkpoint is a file, as an
  // application's would be.
  async checkpointed(request) {
    const checkpoint = request.file ? await checkpointers.file(request.file) : checkpointers.inMemory();
    const events = [];
    try {
      for (const count of request.counts) {
        const options = { startBlock: BigInt(request.start), checkpoint };
        const stream = await networkOf(request).getChaincodeEvents(contractName, options);
        events.push(...await take(stream, count, async (event) => {
          await checkpoint.checkpointChaincodeEvent(event);
          return plainEvent(event);
        }));
      }
    } finally {
      await checkpoint.close?.();
    }
    return { events };
  },
  async blocks(request) {
    const options = request.start === undefined ? {} : { startBlock: BigInt(request.start) };
    const stream = await networkOf(request).getBlockEvents(options);
    return { blocks: await take(stream, request.count, plainBlock) };
  },
  async filtered(request) {
    const stream = await networkOf(request).getFilteredBlockEvents({ startBlock: BigInt(request.start) });
    return { blocks: await take(stream, request.count, plainFiltered) };
  },
  // Fabric's own Deliver services: the numbers of the blocks, and the status that came behind them.
  async seek(request) {
    const [client, method, Response] = deliverServices[request.service];
    const envelope = await seekEnvelope(request);
    const stream = client().makeBidiStreamRequest(method, toBuffer, Response.deserializeBinary, within());
    const numbers = [];
    return new Promise((resolve, reject) => {
      stream.on('error', reject);
      stream.on('end', () => resolve({ numbers }));
      stream.on('data', (response) => {
        if (response.getTypeCase() === Response.TypeCase.STATUS) {
          resolve({ numbers, status: response.getStatus() });
          stream.end();
          return;
        }
        const block = response.getBlock?.() ?? response.getFilteredBlock?.() ?? response.getBlockAndPrivateData?.().getBlock();
        numbers.push(block.getHeader ? block.getHeader().getNumber() : block.getNumber());
      });
      stream.write(envelope);
    });
  },
};

function plainError(error) {
  return {
    name: error.name, message: error.message, code: error.code, transactionId: error.transactionId,
    details: (error.details instanceof Array ? error.details : []).map((detail) => detail.message),
  };
}

readline.createInterface({ input: process.stdin }).on('line', async (line) => {
  const request = JSON.parse(line);
  let answer;
  try {
    request.session = sessionOf(request.identity);
    answer = await operations[request.op](request);
  } catch (error) {
    answer = { error: plainError(error) };
  }
  process.stdout.write(`${JSON.stringify({ id: request.id, ...answer })}\n`);
}).on('close', () => process.exit(0));
