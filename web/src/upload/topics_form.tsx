import { plural } from '../ui/format.js';
import { Field } from '../ui/parts.js';
import { undecided, type Selected, type Topic, type Word } from './topics.js';

export interface TopicsFormProps {
  topics: readonly Topic[];
  selected: Selected;
  onSelect: (selected: Selected) => void;
  /** Whether the frame of the poses is asked for, too. */
  withFrame?: boolean;
}

const kLabels: Record<Word, { label: string; hint: string; unset: string; none?: string }> = {
  cloud: { label: 'Scans', hint: 'The map is made of one lidar’s scans.', unset: 'Choose a topic' },
  poses: { label: 'Poses', hint: 'Without poses, odometry finds how the lidar moved.', unset: 'Automatic', none: 'None: use odometry' },
  gnss: { label: 'GNSS', hint: 'Places the map on the Earth, and turns it to east and north.', unset: 'Not used' },
  imu: { label: 'IMU', hint: 'Odometry turns with it. If there is only one, it is used.', unset: 'Automatic', none: 'None' },
};

/** Asks which topics of a recording are used. */
export function TopicsForm({ topics, selected, onSelect, withFrame }: TopicsFormProps) {
  const missing = undecided(topics, selected);
  const words = (Object.keys(kLabels) as Word[]).filter((word) => topics.some((topic) => topic.word === word));
  const select = (change: Selected): void => onSelect({ ...selected, ...change });
  return (
    <fieldset class="topics">
      <legend class="field-label">Topics of the recording</legend>
      {words.map((word) => (
        <TopicField
          key={word} word={word} isMissing={missing.includes(word)} value={selected[word] ?? ''}
          topics={topics.filter((topic) => topic.word === word)} onValue={(value) => select({ [word]: value })}
        />
      ))}
      {withFrame === true && words.includes('poses') && (
        <Field label="Frame of the poses" hint="Only if the messages do not name it, or name it wrong.">
          {(props) => (
            <input {...props} placeholder="as in the messages" value={selected.pose_frame ?? ''} onInput={(event) => select({ pose_frame: event.currentTarget.value })} />
          )}
        </Field>
      )}
    </fieldset>
  );
}

function TopicField({ word, topics, isMissing, value, onValue }: {
  word: Word; topics: readonly Topic[]; isMissing: boolean; value: string; onValue: (value: string) => void;
}) {
  const { label, hint, unset, none } = kLabels[word];
  const [only] = topics;
  if (word === 'cloud' && topics.length === 1 && only !== undefined) return <p class="quiet">Scans are on {wordsOf(only)}.</p>;
  return (
    <Field label={label} hint={hint}>
      {(props) => (
        <select {...props} required={isMissing} value={value} onChange={(event) => onValue(event.currentTarget.value)}>
          <option value="">{isMissing ? 'Choose a topic' : unset}</option>
          {topics.map((topic) => <option key={topic.topic} value={topic.topic}>{wordsOf(topic)}</option>)}
          {none !== undefined && <option value="none">{none}</option>}
        </select>
      )}
    </Field>
  );
}

function wordsOf({ topic, messages, frame_id }: Topic): string {
  const count = messages === 0 ? '' : ` (${plural(messages, 'message')})`;
  return `${topic}${count}${frame_id === '' ? '' : ` in ${frame_id}`}`;
}
