import { plural } from '../ui/format.js';
import { Field } from '../ui/parts.js';
import { topicsIn, undecided, wordsIn, type Selected, type Topic, type Word } from './topics.js';

export interface TopicsFormProps {
  topics: readonly Topic[];
  selected: Selected;
  onSelect: (selected: Selected) => void;
  /** Whether the frame of the poses and other words are asked for, too. */
  withRest?: boolean;
  /** The text of the recording's own `topics.txt`. */
  ownWords?: string | undefined;
}

const kLabels: Record<Word, { label: string; hint: string; unset: string; none?: string }> = {
  cloud: { label: 'Scans', hint: 'The lidar that gives the stamps and the poses.', unset: 'Choose a topic' },
  poses: { label: 'Poses', hint: 'Without poses, odometry finds how the lidar moved.', unset: 'Automatic', none: 'None: use odometry' },
  gnss: { label: 'GNSS', hint: 'Places the map on the Earth, and turns it to east and north.', unset: 'Not used' },
  imu: { label: 'IMU', hint: 'Odometry turns with it. If there is only one, it is used.', unset: 'Automatic', none: 'None' },
};

/** Asks which topics of a recording are used. */
export function TopicsForm({ topics, selected, onSelect, withRest, ownWords }: TopicsFormProps) {
  const missing = undecided(topics, selected, ownWords);
  const own = wordsIn(ownWords ?? '');
  const words = (Object.keys(kLabels) as Word[]).filter((word) => topics.some((topic) => topic.word === word));
  const select = (change: Selected): void => onSelect({ ...selected, ...change });
  return (
    <fieldset class="topics">
      <legend class="field-label">Topics of the recording</legend>
      {words.map((word) => (
        <TopicField
          key={word} word={word} isMissing={missing.includes(word)} value={selected[word] ?? ''}
          topics={topics.filter((topic) => topic.word === word)} own={own.get(word)} onValue={(value) => select({ [word]: value })}
        />
      ))}
      {withRest === true && words.includes('poses') && (
        <Field label="Frame of the poses" hint="Only if the messages do not name it, or name it wrong.">
          {(props) => (
            <input {...props} placeholder="as in the messages" value={selected.pose_frame ?? ''} onInput={(event) => select({ pose_frame: event.currentTarget.value })} />
          )}
        </Field>
      )}
      {withRest === true && (
        <Field label="Other words" hint="As the text above names them, for example stamps=recorded, points=map or calibration=64e.yaml, with & between two.">
          {(props) => (
            <input {...props} spellcheck={false} value={selected.other ?? ''} onInput={(event) => select({ other: event.currentTarget.value })} />
          )}
        </Field>
      )}
    </fieldset>
  );
}

interface TopicFieldProps {
  word: Word;
  topics: readonly Topic[];
  isMissing: boolean;
  value: string;
  /** What the recording's own `topics.txt` says. */
  own: string | undefined;
  onValue: (value: string) => void;
}

function TopicField({ word, topics, isMissing, value, own, onValue }: TopicFieldProps) {
  const { label, hint, unset, none } = kLabels[word];
  const [only] = topics;
  const [first = '', ...others] = word === 'cloud' ? topicsIn(value) : [value];
  if (word === 'cloud' && topics.length === 1 && only !== undefined) return <p class="quiet">Scans are on {wordsOf(only)}.</p>;
  return (
    <>
      <Field label={label} hint={hint}>
        {(props) => (
          <select {...props} required={isMissing} value={first} onChange={(event) => onValue(event.currentTarget.value)}>
            <option value="">{own !== undefined ? `As topics.txt says: ${own}` : isMissing ? 'Choose a topic' : unset}</option>
            {topics.map((topic) => <option key={topic.topic} value={topic.topic}>{wordsOf(topic)}</option>)}
            {none !== undefined && <option value="none">{none}</option>}
          </select>
        )}
      </Field>
      {word === 'cloud' && first !== '' && topics.length > 1 && (
        <OtherLidars topics={topics.filter(({ topic }) => topic !== first)} chosen={others} onChosen={(some) => onValue([first, ...some].join(','))} />
      )}
    </>
  );
}

/** Lidars whose scans join those of the first. */
function OtherLidars({ topics, chosen, onChosen }: { topics: readonly Topic[]; chosen: readonly string[]; onChosen: (chosen: string[]) => void }) {
  return (
    <div class="others" role="group" aria-label="Other lidars">
      <p class="hint">Other lidars of the same vehicle, if /tf_static says where they stand:</p>
      {topics.map((topic) => (
        <label key={topic.topic} class="check">
          <input
            type="checkbox" checked={chosen.includes(topic.topic)}
            onChange={({ currentTarget: { checked } }) =>
              onChosen(checked ? [...chosen, topic.topic] : chosen.filter((one) => one !== topic.topic))}
          />
          {wordsOf(topic)}
        </label>
      ))}
    </div>
  );
}

function wordsOf({ topic, messages, frame_id }: Topic): string {
  const count = messages === 0 ? '' : ` (${plural(messages, 'message')})`;
  return `${topic}${count}${frame_id === '' ? '' : ` in ${frame_id}`}`;
}
